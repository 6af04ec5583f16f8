"""Whether an unfinished or finished output belongs to what is asked for now; if not, which setting or file differs."""

from collections.abc import Iterator, Mapping
from typing import Any

from mdtopo.typing import JsonObject

HASH = "sha256_of_size_and_first_and_last_mebibyte"


def differences(stored: JsonObject, asked: JsonObject) -> Iterator[str]:
    """Yield in words what differs between two runs: version, settings, request, input files.

    Parameters
    ----------
    stored, asked : mapping
        With the keys ``version``, ``config``, ``request`` and ``inputs``, as JSON gives them back.
    """
    if stored["version"] != asked["version"]:
        yield f"it was begun by mdtopo {stored['version']}, and this is mdtopo {asked['version']}"
    for group in ("config", "request"):
        yield from _differing(stored[group], asked[group])
    before, now = stored["inputs"], asked["inputs"]
    if len(before) != len(now):
        yield f"it was begun with {len(before)} input files, and now there are {len(now)}"
        return
    for one, other in zip(before, now, strict=True):
        if one["size"] != other["size"]:
            yield f"the size of {other['path']} was {one['size']} bytes, and now is {other['size']}"
        elif one[HASH] != other[HASH]:
            yield f"the content of {other['path']} has changed (sha256 {one[HASH][:12]}… then, {other[HASH][:12]}… now)"


def _differing(stored: Mapping[str, Any], asked: Mapping[str, Any]) -> Iterator[str]:
    for name in dict.fromkeys([*stored, *asked]):
        before, now = stored.get(name), asked.get(name)
        if before != now:
            yield f"{name} was {_word(before)}, and now is {_word(now)}"


def _word(value: Any) -> str:
    return "not given" if value is None else repr(value)
