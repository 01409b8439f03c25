"""The syntax of a language in which the elastic law and the layers are written out."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

from qlvbayes.use.exports.layers import ElasticFunction, ExportedLayer


class Language(ABC):
    """The syntax of a language, for functions of scalars."""

    @abstractmethod
    def library(self, name: str) -> str:
        """Return a function of C's library in the language's own."""

    @abstractmethod
    def number(self, value: float) -> str:
        """Return a literal."""

    @abstractmethod
    def constant(self, name: str) -> str:
        """Return a law's constant."""

    @abstractmethod
    def own(self, name: str) -> str:
        """Return the name of a function that is generated."""

    @abstractmethod
    def either(self, condition: str, yes: str, no: str) -> str:
        """Return ``yes`` where the condition holds, else ``no``."""

    @abstractmethod
    def function(self, one: ElasticFunction, body: list[str], result: str) -> str:
        """Return a function of the elastic law, from its statements and the value's expression."""

    @abstractmethod
    def truth(self, value: bool) -> str:
        """Return the literal of true or of false."""

    @abstractmethod
    def opposite(self, condition: str) -> str:
        """Return where a condition does not hold."""

    top: ClassVar[str]
    """The outermost layer's state, within the pad's."""

    @abstractmethod
    def within(self, way: str, member: str) -> str:
        """Return what a layer writes for a member of its own, of the state that lies at ``way``."""

    @abstractmethod
    def memory(self, index: int) -> str:
        """Return a number that the layer remembers."""

    @abstractmethod
    def beneath(self, index: int, count: int) -> str:
        """Return a state of the layer beneath, of so many."""

    @abstractmethod
    def set(self, name: str, text: str, *, truth: bool) -> str:
        """Return a statement that gives a number, or a condition, its name."""

    @abstractmethod
    def remember(self, index: int, text: str) -> str:
        """Return a statement that sets what the layer remembers."""

    @abstractmethod
    def declared(self, below: str, name: str) -> str:
        """Return a statement that makes room for a state of the layer beneath."""

    @abstractmethod
    def copy(self, below: str, name: str, location: str) -> str:
        """Return a statement that copies a state of the layer beneath."""

    def keep(self, location: str, name: str) -> str:
        """Return a statement that puts a state where the layer keeps it: it copies the whole."""
        return f"{location} = {name};"

    @abstractmethod
    def begin(self, below: str, location: str, displacement: str) -> str:
        """Return a statement with which the layer beneath begins."""

    @abstractmethod
    def step(self, below: str, name: str | None, location: str, line: list[str]) -> str:
        """Return a statement with which the layer beneath goes along a line."""

    @abstractmethod
    def layer(self, piece: ExportedLayer, below: str, begin: list[str], step: list[str]) -> str:
        """Return both functions of a layer, from their statements."""

    @abstractmethod
    def late(self, piece: ExportedLayer, below: str) -> str:
        """Return both functions of a late channel, which keeps the lines that are on their way."""
