"""What was assumed: the conditions under which the numbers of a run hold, in sentences and as rows of a table."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from pl_mc.report.document import Block, Bullets, Heading, Paragraph
from pl_mc.report.files import to_markdown

ASSUMED = "assumptions.md"
BY_DEFAULT = "by default"


@dataclass(frozen=True)
class Condition:
    """One condition.

    Attributes:
        topic: heading under which it stands.
        field: its path in the experiment, ``geometry.mask_deg``, or that of an option of a method.
        value: as text.
        meaning: what it means, without a full stop.
        by_default: whether the value is the default.
    """

    topic: str
    field: str
    value: str
    meaning: str
    by_default: bool

    @property
    def said(self) -> str:
        """Its value, and whether it is the default."""
        return f"{self.value} ({BY_DEFAULT})" if self.by_default else self.value

    @property
    def sentence(self) -> str:
        """``mask_deg`` is 10, by default: elevation mask [deg]."""
        default = f", {BY_DEFAULT}" if self.by_default else ""
        return f"{_code(self.field)} is {_code(self.value)}{default}{f': {self.meaning}' if self.meaning else ''}."


@dataclass(frozen=True)
class Assumed:
    """All conditions of a run.

    Attributes:
        lead: sentences about what holds of every number.
        conditions: of every field of the experiment and every option, topic by topic.
    """

    lead: tuple[str, ...]
    conditions: tuple[Condition, ...]

    def markdown(self, title: str, choices: Sequence[str] = ()) -> str:
        """The text of ``assumptions.md``; ``choices`` are those that the run made."""
        return to_markdown(f"What was assumed: {title}", tuple(self._blocks(choices)))

    def _blocks(self, choices: Sequence[str]) -> Iterator[Block]:
        yield Paragraph("The numbers of this run hold under these conditions, and are not to be quoted without them.")
        yield Bullets(self.lead)
        if choices:
            yield Heading("What the run chose or left out")
            yield Bullets(tuple(choices))
        for topic in dict.fromkeys(condition.topic for condition in self.conditions):
            yield Heading(topic)
            yield Bullets(tuple(one.sentence for one in self.conditions if one.topic == topic))


def _code(text: str) -> str:
    """Text in which nothing marks anything."""
    return f"`{' '.join(text.replace('`', chr(39)).split())}`"
