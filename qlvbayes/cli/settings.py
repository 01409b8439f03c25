"""Choices that stand in one file, ``study.toml``, or are given as options.

Every key of the file is also an option of the commands that use it: ``sign = "force"`` is ``--sign
force``. So a command shows few options, and all that read share the others, with one help.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import msgspec

from qlvbayes.io.catalogue import ELASTIC, METHODS, MOST_MODES, NOISES, RELAXATION
from qlvbayes.io.checks import InputError, check_known
from qlvbayes.io.files import write_whole

if TYPE_CHECKING:
    from qlvbayes.diagnosis.settings import DiagnosisSettings
    from qlvbayes.fitting.ensemble import Settings as SamplerSettings
    from qlvbayes.io.data import Measurements
    from qlvbayes.io.formats import Format
    from qlvbayes.io.loading import Answers
    from qlvbayes.model.choices import Choices
    from qlvbayes.pipeline.source import Source

FILE = "study.toml"
"""Name of the file that a study writes into its folder of results."""
PRONY = next(iter(RELAXATION))  # the only one that takes a number of modes
SEVERAL = tuple[str, ...]


@dataclass(frozen=True)
class Key:
    """A key of the file: what it holds, and what it is for."""

    kind: Any  # str, float, int, bool, Path or SEVERAL
    what: str
    part: str  # the part of a command that uses it


KEYS = {
    "sign": Key(
        str, "what to turn over so that pressing is positive: none, displacement, force, both",
        "reading",
    ),
    "contact": Key(
        str, "displacement at contact in the file's unit, or 'file': its own zero", "reading"
    ),
    "units": Key(
        str, "units of time, displacement, force where the files state none: s,mm,N", "reading"
    ),
    "area": Key(
        float, "area (mm2), where strain meets force or displacement stress", "reading"
    ),
    "columns": Key(
        str, "columns of time, displacement (or strain) and force (or stress), by name as t,x,F or "
        "by number as 1,2,3: for a table whose columns are not recognised", "reading",
    ),
    "tests": Key(str, "names of the tests, as 'slow,fast'", "reading"),
    "pad-from": Key(
        str, "a regular expression that finds the pad's name in each test's, as '^[A-Z]+' finds AA "
        "in AA1: for files of several specimens; '.+' makes each test a pad", "reading",
    ),
    "formats-file": Key(Path, "a Python file with formats of your own", "reading"),
    "keep-all-readings": Key(
        bool, "keep readings that their neighbours and the other channel contradict: lost ones, "
        "spikes, a stuck or clipped channel; without it they are left out and named", "tests",
    ),
    "use": Key(
        SEVERAL, "the part of a test that is used, as 'TEST:0..18mm' or 'TEST:0..12s': what lies "
        "before and behind it is left out; repeatable", "tests",
    ),
    "leave-out": Key(
        SEVERAL, "a part of a test whose force does not count while its motion does, as "
        "'TEST:30..45s', 'TEST:0..0.1mm' or 'TEST:hold 2'; repeatable", "tests",
    ),
    "bonded": Key(
        bool, "the specimen is fixed to the platen and can pull (--loose: it is not); without it "
        "loose for displacement and force, bonded for strain and stress", "tests",
    ),
    "add": Key(
        SEVERAL, "an effect to put into the model, as 'viscous_drag'; repeatable", "model"
    ),
    "elastic": Key(str, f"elastic law, one of {', '.join(ELASTIC)}", "model"),
    "relaxation": Key(
        str, f"relaxation, one of {', '.join(RELAXATION)}; prony:3 (or --modes 3) has 3 modes, "
        "without it prony:2", "model",
    ),
    "noise": Key(str, f"noise model, one of {', '.join(NOISES)}", "model"),
    "rested": Key(
        bool, "take every test to begin with a pad at rest: assume no effect of the test before",
        "model",
    ),
    "prior": Key(SEVERAL, "a prior, as 'v[1]=lognormal(1.8,0.5)'; repeatable", "model"),
    "fix": Key(SEVERAL, "a fixed constant, as 'v[2]=0.14'; repeatable", "model"),
    "effects-file": Key(Path, "a Python file with effects of your own", "model"),
    "laws-file": Key(Path, "a Python file with laws of your own", "model"),
    "method": Key(str, f"way to the constants, one of {', '.join(METHODS)}", "method"),
    "walkers": Key(int, "walkers of the ensemble, 4 or more; without it 32", "sampling"),
    "max-steps": Key(
        int, "steps of the sampler at most, 10 or more; without it 100000", "sampling"
    ),
    "tolerance": Key(
        str, "share of the peak force below which structure does not matter, as 1% or 0.01; "
        "without it 1%", "diagnosis",
    ),
    "references": Key(
        Path, "values to show next to the constants: a CSV file pad,parameter,value,unit; without "
        "it paper_table1.csv next to FILE, if it is there", "tables",
    ),
}  # fmt: skip
"""All keys but those that are options of their own: files, pads and seed."""

PARTS = {
    "look": ("reading", "tests"),
    "study": ("reading", "tests", "model", "sampling", "diagnosis", "tables"),
    "fit": ("reading", "tests", "model", "method", "sampling", "tables"),
    "diagnose": ("reading", "tests", "model", "diagnosis"),
}
"""Parts of the keys that a command uses."""
_ARGUMENTS = {
    "files": Key(SEVERAL, "a list of files", ""),
    "pads": Key(str, "a text", ""),
    "seed": Key(Annotated[int, msgspec.Meta(ge=0)], "a number of 0 or more", ""),
}
"""Keys of the file that are arguments and options of their own."""


def keys_of(command: str) -> dict[str, Key]:
    """Return the keys that a command uses."""
    return {name: key for name, key in KEYS.items() if key.part in PARTS.get(command, ())}


def expanded(command: str, words: Sequence[str]) -> list[str]:
    """Return a command's words with ``--sign force`` written as ``--set sign=force``."""
    known, left, given = keys_of(command), list(words), list[str]()
    while left:
        word = left.pop(0)
        if word == "--":
            return [*given, word, *left]
        option, equals, value = word.partition("=")
        name = option[2:] if option.startswith("--") else ""
        name = "tests" if name == "test" else name
        if name == "loose" and "bonded" in known:
            given += ["--set", "bonded=false"]
        elif name in known and known[name].kind is bool and not equals:
            given += ["--set", f"{name}=true"]
        elif name in known or (name == "modes" and "relaxation" in known):
            if not equals and not left:
                given.append(word)  # typer says that its value is missing
                continue
            value = value if equals else left.pop(0)
            given += ["--set", f"{name}={value}"]
        else:
            given.append(word)
    return given


def help_lines(command: str) -> list[str]:
    """Return one line for each key that a command uses."""
    return [f"--{name}: {key.what}." for name, key in keys_of(command).items()]


@dataclass(frozen=True)
class StudySettings:
    """The values of keys, from a file and from options."""

    values: dict[str, Any]

    @classmethod
    def from_options(cls, file: Path | None, options: Iterable[str]) -> StudySettings:
        """Return the settings of a file, with those of options in their place."""
        named: dict[str, Any] = {}
        modes = None
        for text in options:
            name, equals, value = text.partition("=")
            name = name.strip().replace("_", "-")
            if not equals:
                raise InputError(f"'{text}' sets nothing", remedy="write KEY=VALUE")
            if name == "modes":
                modes = value
                continue
            check_known("setting", name, KEYS)
            if KEYS[name].kind is SEVERAL:
                named[name] = (*named.get(name, ()), value)
            else:
                named[name] = _as_kind(name, KEYS[name], value, Path())
        if modes is not None:
            named["relaxation"] = _with_modes(named.get("relaxation"), modes)
        return cls((_read(file) if file else {}) | named)

    def __getitem__(self, name: str) -> Any:
        """Return a value; None where it is not given, and () of those that may be several."""
        several = name in KEYS and KEYS[name].kind is SEVERAL
        return self.values.get(name, () if several else None)

    @property
    def states_reading(self) -> bool:
        """True if any setting says how files of testing machines are read."""
        return any(KEYS[name].part == "reading" for name in self.values if name in KEYS)

    @property
    def formats(self) -> tuple[Format, ...]:
        """Formats of the package, then those of installed packages and of the user's file."""
        from qlvbayes.io.formats import known_formats, own_formats

        file = self["formats-file"]
        return (*known_formats(), *(() if file is None else own_formats(file)))

    def answers(self, pads: tuple[str, ...] = ()) -> Answers:
        """Return the answers for reading machines' files; InputError where one is unusable."""
        from qlvbayes.io.loading import Answers

        tests = tuple(one.strip() for one in (self["tests"] or "").split(",") if one.strip())
        return Answers.from_words(
            sign=self["sign"], contact=self["contact"], units=self["units"], area=self["area"],
            pads=pads, tests=tests, pad_from=self["pad-from"], columns=self["columns"],
        )  # fmt: skip

    def arguments(self) -> list[str]:
        """Return the settings that say how files are read, as arguments of a command."""
        given = [name for name in KEYS if KEYS[name].part == "reading" and name in self.values]
        return [word for name in given for word in (f"--{name}", str(self.values[name]))]

    @property
    def readings(self) -> dict[str, Any]:
        """Return which readings count, as arguments of `qlvbayes.motion.experiment.prepare`."""
        keep = bool(self["keep-all-readings"])
        return {"keep_all_readings": keep, "use": self["use"], "leave_out": self["leave-out"]}

    def choices(self, study: Measurements) -> Choices:
        """Return the model's description; raise InputError where a setting cannot be used."""
        from qlvbayes.model.choices import Choices

        law, modes = relaxation_of(self["relaxation"])
        bonded = study.units.bonded_default if self["bonded"] is None else self["bonded"]
        files: dict[str, Any] = {
            f"{what}_file": str(self[f"{what}-file"].resolve())
            for what in ("laws", "effects")
            if self[f"{what}-file"]
        }
        return Choices(
            elastic=self["elastic"] or next(iter(ELASTIC)), modes=modes, relaxation=law,
            noise=self["noise"] or next(iter(NOISES)), priors=self["prior"], fixed=self["fix"],
            bonded=bonded, effects=self["add"], rested=bool(self["rested"]), **self.readings,
            **files,
        )  # fmt: skip

    def choices_of(self, source: Source) -> Choices:
        """Return the model's description for pads; raise InputError also on an unknown test.

        Of several tidy files one is read at a time, so that no test can be missed before the last.
        """
        from qlvbayes.motion.pad import refuse_unknown

        choices = self.choices(source.whole)
        if source.is_complete:
            refuse_unknown(source.whole.pads, choices.use, choices.leave_out)
        return choices

    def seed(self, given: int | None) -> int:
        """Return the seed that is given as an option, or that of the file, or 0."""
        return given if given is not None else self["seed"] or 0

    def sampler(self, seed: int) -> SamplerSettings:
        """Return the settings of the sampler."""
        from qlvbayes.fitting.ensemble import Settings as SamplerSettings

        given = {"walkers": self["walkers"], "max_steps": self["max-steps"]}
        for (name, value), least in zip(given.items(), (4, 10), strict=True):
            if value is not None and value < least:
                raise InputError(f"{name} is {value}", remedy=f"give {least} or more")
        return SamplerSettings(seed=seed, **{k: v for k, v in given.items() if v is not None})

    def thresholds(self) -> DiagnosisSettings:
        """Return the thresholds of the diagnosis."""
        from qlvbayes.diagnosis.settings import DiagnosisSettings

        given = self["tolerance"]
        if given is None:
            return DiagnosisSettings()
        return DiagnosisSettings(tolerance=share_of(given))

    def write(self, out: Path, files: Sequence[Path], pads: str, seed: int) -> None:
        """Write ``out/study.toml``, from which the same study is run again."""
        values = self.values | {"files": tuple(files), "pads": pads, "seed": seed}
        lines = ["# qlvbayes study --settings study.toml -o OUT"]
        lines += [f"{name} = {_as_toml(value)}" for name, value in values.items() if value != ""]
        write_whole(out / FILE, ("\n".join(lines) + "\n").encode())


def relaxation_of(text: str | None) -> tuple[str, int]:
    """Return the name and the number of modes that ``--relaxation`` states."""
    name, colon, number = (text or PRONY).partition(":")
    if not colon:
        return name, 2
    if name != PRONY or not number.isdecimal() or not 1 <= int(number) <= MOST_MODES:
        known = ", ".join(RELAXATION)
        remedy = f"use {PRONY}:1 to :{MOST_MODES}, or {known}"
        raise InputError(f"no relaxation {text!r}", remedy=remedy)
    return name, int(number)


def share_of(text: str) -> float:
    """Return the share that ``1%`` or ``0.01`` states; raise InputError where it is none."""
    number, percent, rest = text.strip().partition("%")
    try:
        return float(number) / (100.0 if percent and not rest else 1.0)
    except ValueError:
        raise InputError(f"no share {text!r}", remedy="write it as 1% or 0.01") from None


def _with_modes(relaxation: str | None, modes: str) -> str:
    name, colon, number = (relaxation or PRONY).partition(":")
    if name != PRONY:
        raise InputError(f"--modes is of a Prony series, not of {name}", remedy="leave it out")
    if colon and number != modes:
        raise InputError(f"--relaxation {relaxation} and --modes {modes} differ", remedy="give one")
    return f"{PRONY}:{modes}"


def _read(file: Path) -> dict[str, Any]:
    """Return the values of a file; those of paths count from its folder."""
    try:
        content = tomllib.loads(file.read_text(encoding="utf-8"))
    except UnicodeDecodeError as error:
        raise InputError("no text in UTF-8", file=file, remedy="write it anew") from error
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"no TOML: {error}", file=file, remedy='write KEY = "VALUE"') from error
    values: dict[str, Any] = {}
    known = KEYS | _ARGUMENTS
    try:
        for written, value in content.items():
            check_known("setting", name := written.replace("_", "-"), known)
            values[name] = _as_kind(name, known[name], value, file.parent)
    except InputError as error:
        raise InputError(error.message, file=file, remedy=error.remedy) from None
    if "files" in values:
        values["files"] = tuple(file.parent / one for one in values["files"])
    return values


def _as_kind(name: str, key: Key, given: Any, folder: Path) -> Any:
    """Return what a file or an option gives, as the kind of its key; paths count from a folder."""
    if key.kind is str and type(given) in (int, float):
        return str(given)
    kind = str if key.kind is Path else key.kind
    try:
        value = msgspec.convert(given, kind, strict=not isinstance(given, str))
    except msgspec.ValidationError:
        raise InputError(f"{name} is {given!r}", remedy=f"it is {key.what}") from None
    return folder / value if key.kind is Path else value


def _as_toml(value: Any) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(map(_as_toml, value))}]"
    if isinstance(value, Path):
        value = str(value.resolve())
    return json.dumps(value, ensure_ascii=False)
