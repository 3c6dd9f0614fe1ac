"""Read YAML from untrusted sources. Only plain types are allowed, and no aliases, because a few lines of nested aliases can fill all
memory. The size of the text is limited.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import yaml

MAX_CHARACTERS = 4_000_000  # parsing them takes about 40 s and 0.5 GB


def loader() -> type[yaml.SafeLoader]:
    """Return a YAML loader for plain types. For an alias, it raises a yaml.YAMLError with the line number."""
    import yaml
    from yaml.composer import ComposerError

    class Plain(yaml.SafeLoader):
        def compose_node(self, parent: Any, index: Any) -> Any:
            if self.check_event(yaml.AliasEvent):
                mark = self.peek_event().start_mark
                raise ComposerError(None, None, "aliases (*name) are not supported; write the value itself", mark)
            return super().compose_node(parent, index)

    return Plain


def load(text: str, kind: type[yaml.SafeLoader] | None = None) -> Any:
    """Parse a YAML text with the loader `kind`, by default `loader()`. Raises yaml.YAMLError, and ValueError for a too large text."""
    import yaml

    if len(text) > MAX_CHARACTERS:
        raise ValueError(f"it has more than {MAX_CHARACTERS:,} characters")
    return yaml.load(text, kind or loader())
