"""Warnings and suggestions about the category that a photo shows.

The loss of a fit cannot tell: a model of chairs fits a car as some grey chair, possibly with a confident camera. So a
detector trained on photographs decides (:mod:`core.photos.detector`). ``guess`` is its ``Photo.categories``: the
probability of each category by name, empty if unknown; the rest up to 1 is the probability of none of them.
"""

from collections.abc import Mapping, Sequence
from math import prod

from core.models.library import DEFAULT_MODEL
from core.models.model_file import singular
from core.photos.photo import Photo

UNLIKELY = 0.3  # probability of a category below which people are warned
_SURE = 0.7  # with doubtful masks, chairs and cars have 0.74 or more; a house has 0.53, a bridge 0.64
_CLEAR = 0.9  # one category's fraction of the probability of all, above which no other is offered


def category_likelihood(category: str, photos: Sequence[Photo]) -> float:
    """Return the probability, 0..1, that the object of the photos is of the category; 1 if no photo tells.

    Each photo is evidence of its own, so that eight photos of probability 0.8 make it nearly certain.
    """
    shares = [photo.categories[category] for photo in photos if category in photo.categories]
    product = prod(shares)
    not_shown = prod(1 - fraction for fraction in shares)
    return product / (product + not_shown) if shares and product else product


def likeliest_category(guess: Mapping[str, float]) -> str | None:
    """Return the likeliest category; None if the image more probably shows none of them, or nothing is known."""
    if not guess:
        return None
    name, probability = max(guess.items(), key=lambda item: item[1])
    return name if probability > 1 - sum(guess.values()) else None


def is_sure(guess: Mapping[str, float]) -> bool:
    """Return whether one category is much likelier than the others and than none of them.

    Example:
        >>> is_sure({"cars": 0.82, "chairs": 0.03}), is_sure({"cars": 0.53, "chairs": 0.09}), is_sure({})
        (True, False, False)
    """
    return max(guess.values(), default=0.0) >= _SURE


def likeliest_model(guess: Mapping[str, float]) -> str:
    """Return the name of the likeliest category's model, however unlikely; the default model's if nothing is known.

    Example:
        >>> likeliest_model({"cars": 0.2, "chairs": 0.1})
        'cars'
    """
    return max(guess, key=lambda name: guess[name], default=DEFAULT_MODEL)


def describe_ambiguity(guess: Mapping[str, float]) -> str:
    """Return a command-line hint at the second category of an ambiguous image, or "".

    Example:
        >>> describe_ambiguity({"cars": 0.6, "chairs": 0.2})
        'it may also be a chair: --model chairs'
        >>> describe_ambiguity({"cars": 0.95, "chairs": 0.02})
        ''
    """
    second = sorted(guess, key=lambda name: -guess[name])[1:2]
    unsure = second and max(guess.values()) < _CLEAR * sum(guess.values())
    return f"it may also be a {singular(second[0])}: --model {second[0]}" if unsure else ""


def describe_difference(first: Mapping[str, float], second: Mapping[str, float]) -> str:
    """Return a warning if two images probably show different categories, or "".

    Example:
        >>> describe_difference({"cars": 0.9, "chairs": 0.05}, {"cars": 0.1, "chairs": 0.8})
        'this looks like a chair, the first image like a car: the images of one fit show one object'
        >>> describe_difference({"cars": 0.9}, {"cars": 0.2})
        ''
    """
    first_name, name = (likeliest_category(guess) for guess in (first, second))
    if first_name is None or name is None or first_name == name:
        return ""
    difference = f"this looks like a {singular(name)}, the first image like a {singular(first_name)}"
    return f"{difference}: the images of one fit show one object"


def describe_category(guess: Mapping[str, float], category: str) -> str:
    """Return a warning if a photo is unlikely to show the model's category, or "".

    Example:
        >>> describe_category({"cars": 0.95, "chairs": 0.03}, "chairs")
        'this looks like a car, not a chair: try the cars model'
        >>> describe_category({"cars": 0.1, "chairs": 0.1}, "chairs")
        'this does not look like a chair'
    """
    if guess.get(category, 1.0) >= UNLIKELY:
        return ""
    likeliest = likeliest_category(guess)
    if likeliest in (None, category):
        return f"this does not look like a {singular(category)}"
    return f"this looks like a {singular(likeliest)}, not a {singular(category)}: try the {likeliest} model"
