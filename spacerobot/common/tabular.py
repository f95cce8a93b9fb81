"""Base class of results that have tables."""

from __future__ import annotations

from collections.abc import Sequence

from spacerobot.common.tables import Content, content_html


class Tabular:
    """Base class of results that have tables: ``print`` shows them as text, and notebooks as HTML."""

    def content(self) -> Sequence[Content]:
        """Tables and sentences, the most important first."""
        raise NotImplementedError

    def verdict(self) -> Sequence[str]:
        """Outcome in sentences, with which a page of the result begins."""
        return ()

    def notices(self) -> Sequence[str]:
        """Warnings about the result."""
        return ()

    def __str__(self) -> str:
        """Text of the content, as the command line prints it."""
        from spacerobot.common.text_tables import text_of

        return text_of(self._content_and_notices())

    def _repr_html_(self) -> str:
        """HTML of the content, for notebooks."""
        return content_html(self._content_and_notices())

    def _content_and_notices(self) -> list[Content]:
        return [*self.content(), *(f"warning: {text}" for text in self.notices())]
