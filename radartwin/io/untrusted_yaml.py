"""Read YAML from untrusted sources. Only plain types are allowed, and no aliases, because a few lines of nested aliases can fill all
memory.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import yaml


def loader() -> type[yaml.SafeLoader]:
    """Return a YAML loader for plain types without aliases. For an alias, the loader raises a yaml.YAMLError with the line number."""
    import yaml
    from yaml.composer import ComposerError

    class Plain(yaml.SafeLoader):
        def compose_node(self, parent: Any, index: Any) -> Any:
            if self.check_event(yaml.AliasEvent):
                mark = self.peek_event().start_mark
                raise ComposerError(None, None, "aliases (*name) are not supported; write the value itself", mark)
            return super().compose_node(parent, index)

    return Plain


def load(text: str) -> Any:
    import yaml

    return yaml.load(text, loader())
