"""Objects whose model is not open: kept, compared and written like others, but not shown."""

from core.models.codes import Codes
from core.models.model import Instance, Model


class MissingInstance(Instance):
    """An object as a file holds it: codes, and the fingerprint of their model. Compared by value.

    Its :attr:`model` raises ``ValueError``. :meth:`core.models.open_models.OpenModels.adopt` finds the model.
    """

    def __init__(self, fingerprint: str, codes: Codes) -> None:
        object.__setattr__(self, "_fingerprint", fingerprint)
        object.__setattr__(self, "codes", codes)

    def __repr__(self) -> str:
        return f"MissingInstance({self.fingerprint!r}, {self.codes!r})"

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle the fingerprint and the codes."""
        return MissingInstance, (self.fingerprint, self.codes)

    @property
    def model(self) -> Model:
        """Raises ``ValueError``."""
        raise ValueError("it belongs to a model that is not open: drop the model's file on the window first")

    @property
    def fingerprint(self) -> str:
        """Fingerprint of the missing model."""
        return self._fingerprint  # type: ignore[attr-defined]

    @property
    def is_missing(self) -> bool:
        """True."""
        return True

    def with_codes(self, codes: Codes) -> "MissingInstance":
        """Return an object of the same missing model."""
        return MissingInstance(self.fingerprint, codes)


def adopted(model: Model, instance: Instance) -> Instance:
    """Return an object, read from a file, as one of a model, which may extend the object's own.

    Raises ``ValueError`` for an object of another model, or codes that do not fit.
    """
    if not model.shares_codes_with(instance.fingerprint) or not model.fits(instance.codes):
        raise ValueError(f"it belongs to another model, not to this one of {model.category or 'unnamed objects'}")
    return Instance(model, instance.codes)
