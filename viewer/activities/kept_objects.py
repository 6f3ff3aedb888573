"""The added objects that are kept from launch to launch, with their edits."""

from collections.abc import Iterable

from core.models.open_models import OpenModels
from viewer.services.messages import Messages
from viewer.services.user_objects import UserObjects
from viewer.values.objects import EditableObject, ObjectLibrary


class KeptObjects:
    """Adds stored objects to the library, and stores its fitted ones whenever they change."""

    def __init__(self, files: UserObjects, models: OpenModels, objects: ObjectLibrary, messages: Messages) -> None:
        self._files = files
        self._models = models
        self._objects = objects
        self._messages = messages
        self.names = frozenset(objects.match(files.open(models)).values())  # of the objects that were stored before
        self._changes = objects.changes  # of the library when its objects were stored last

    def tick(self) -> None:
        """Store the objects if the library has changed; call once a frame."""
        if self._changes != self._objects.changes:
            self.store()

    def store(self) -> None:
        """Store fitted objects for the next launch, also removed ones; report an error."""
        self._changes = self._objects.changes
        self._store(self._objects.ever_added)

    def close(self) -> None:
        """Store fitted objects, and delete the files of removed ones; report an error."""
        self._store(self._objects.added)

    def _store(self, objects: Iterable[EditableObject]) -> None:
        try:
            self._files.sync(self._models, [added for added in objects if added.fitted])
        except (ValueError, OSError) as error:
            self._messages.report("Cannot keep what was made", error)
