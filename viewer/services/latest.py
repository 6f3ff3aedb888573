"""Values made by the worker: the one for the newest inputs, or one for all inputs so far."""

from collections.abc import Callable, Hashable, Iterable
from dataclasses import dataclass, field
from functools import partial
from typing import Generic, TypeVar

from viewer.services.jobs import Jobs
from viewer.services.worker import Job

Inputs = TypeVar("Inputs", bound=Hashable)
Value = TypeVar("Value")


@dataclass(eq=False)
class Latest(Generic[Inputs, Value]):
    """Keeps one value, and asks the worker for another one when the inputs change."""

    jobs: Jobs
    name: str  # of its jobs
    problem: str  # words before an error's, such as "Cannot measure the object"
    urgent: bool = False  # as its jobs
    weight: float = 1.0  # as its jobs
    silent: type[Exception] | tuple[()] = ()  # an error that is not reported: there is no value, as of any error
    value: Value | None = field(default=None, init=False)  # the newest, perhaps for earlier inputs
    inputs: Inputs | None = field(default=None, init=False)  # those of :attr:`value`
    _asked: Inputs | None = field(default=None, init=False)  # newest inputs that the worker was asked for

    def of(self, inputs: Inputs, make: Callable[[], Iterable[Value | None]], asks: bool = True) -> Value | None:
        """Return the value for the inputs; None until it is made.

        Args:
            make: returns a stream of values, each in place of the one before; called on the worker's thread.
            asks: False does not ask the worker now, as during a drag.
        """
        if asks and inputs != self._asked:
            self._asked = inputs
            job = Job(self.name, make, partial(self._keep, inputs), self._ended, self.urgent, self.weight)
            self.jobs.submit(job)
        return self.value if inputs == self.inputs else None

    @property
    def current(self) -> Value | None:
        """The value for the newest inputs; None until it is made, and after :meth:`close`."""
        return self.value if self.inputs == self._asked else None

    def set(self, inputs: Inputs, value: Value) -> None:
        """Keep a value that is known without the worker."""
        self.close()
        self._asked = inputs
        self._keep(inputs, value)

    def close(self) -> None:
        """Stop, and forget the newest inputs."""
        self.jobs.cancel(self.name)
        self._asked = None

    def _keep(self, inputs: Inputs, value: Value) -> None:
        self.inputs = inputs
        self.value = value

    def _ended(self, error: Exception | None) -> None:
        if error and not isinstance(error, self.silent):
            self.jobs.messages.report(self.problem, error)


@dataclass(eq=False)
class Memo(Generic[Inputs, Value]):
    """Keeps a value for all inputs, each made once. An error is not reported: there is no value then."""

    jobs: Jobs
    name: str  # begin of the names of its jobs
    make: Callable[[Inputs], Iterable[Value | None]]  # yields the value, on the worker's thread
    weight: float = 1.0  # as its jobs
    _values: dict[Inputs, Value | None] = field(default_factory=dict, init=False)

    def get(self, inputs: Inputs) -> Value | None:
        """Return the value for the inputs, which the worker is asked for once; None until it is made."""
        if inputs not in self._values:
            self._values[inputs] = None
            keep = partial(self._values.__setitem__, inputs)
            name = f"{self.name} {len(self._values)}"
            self.jobs.submit(Job(name, lambda: self.make(inputs), keep, weight=self.weight))
        return self._values[inputs]
