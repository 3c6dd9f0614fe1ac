"""YAML of strangers: safe types only, and no aliases, with which a line can stand for more than memory holds."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import yaml


def loader() -> type[yaml.SafeLoader]:
    """The loader class; reading an alias raises a yaml.YAMLError with its line."""
    import yaml
    from yaml.composer import ComposerError

    class Plain(yaml.SafeLoader):
        def compose_node(self, parent: Any, index: Any) -> Any:
            if self.check_event(yaml.AliasEvent):
                mark = self.peek_event().start_mark
                raise ComposerError(None, None, "aliases (*name) are not read here; write the value out", mark)
            return super().compose_node(parent, index)

    return Plain


def load(text: str) -> Any:
    """The content of one YAML document."""
    import yaml

    return yaml.load(text, loader())
