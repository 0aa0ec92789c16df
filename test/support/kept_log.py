"""A node that has nothing but a logger, which keeps what it is told."""

from __future__ import annotations


class KeptLog:
    """The node and its logger: ``lines`` are (severity, text)."""

    def __init__(self) -> None:
        self.lines: list[tuple[str, str]] = []

    def get_logger(self) -> KeptLog:
        return self

    def get_fully_qualified_name(self) -> str:
        return "/uav1/ekf_node"

    def info(self, text: str) -> None:
        self.lines.append(("info", text))

    def warning(self, text: str) -> None:
        self.lines.append(("warning", text))

    def error(self, text: str) -> None:
        self.lines.append(("error", text))

    def texts(self, severity: str = "") -> list[str]:
        """Return the texts of one severity, or all."""
        return [text for kind, text in self.lines if severity in ("", kind)]
