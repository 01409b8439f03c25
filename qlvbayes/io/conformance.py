"""Named checks of the rules that a law, an effect or a format keeps; all of them run."""

from __future__ import annotations

from collections.abc import Callable, Iterable

Check = tuple[str, Callable[[], None]]
"""Name of a rule, and the function that raises an error where the rule is broken."""


def run_checks(checks: Iterable[Check], error: type[AssertionError]) -> None:
    """Run all checks, and raise one error that lists every broken rule, a line each."""
    broken: list[str] = []
    for number, (_, check) in enumerate(checks):
        try:
            check()
        except error as problem:
            broken.append(str(problem))
            if number == 0:
                break
        except Exception:
            if not broken:
                raise
            break  # what is broken already is the reason
    if broken:
        raise error("\n".join(broken))
