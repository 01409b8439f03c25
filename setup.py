"""Puts ``data/`` into the wheel as ``qlvbayes/data`` and compiles the recursion, where that can be.

All else is in pyproject.toml. Without a C compiler the package is installed as it is: NumPy then
runs the recursion.
"""

import os
from pathlib import Path

from setuptools import Extension, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_ext import build_ext
from setuptools.command.build_py import build_py


class BuildWithData(build_py):
    """An editable installation reads the repository's own folder, and gets no copy."""

    def run(self) -> None:
        """Build the package, then copy the measurements."""
        super().run()
        if not self.editable_mode:
            target = Path(self.build_lib, "qlvbayes", "data")
            self.mkpath(str(target))
            for file in sorted(Path("data").iterdir()):
                self.copy_file(str(file), str(target / file.name))


class BuildLibrary(build_ext):
    """The recursion is a plain library, which any version of Python loads."""

    def get_export_symbols(self, ext: Extension) -> list[str]:
        """Return no symbol of a Python module: the source marks what it exports."""
        return []

    def get_ext_filename(self, fullname: str) -> str:
        """Return a name that Python does not take for a module's."""
        return str(Path(*fullname.split(".")).with_suffix(".library"))


class WheelForAnyPython(bdist_wheel):
    """The library depends on the machine, not on the version of Python."""

    def get_tag(self) -> tuple[str, str, str]:
        """Return the tags of Python, of its binary interface and of the machine."""
        return "py3", "none", super().get_tag()[2]


recursion = Extension(
    "qlvbayes.laws.recursion",
    ["qlvbayes/laws/recursion.c"],
    extra_compile_args=[] if os.name == "nt" else ["-O3", "-ffp-contract=off"],
    optional=True,
)
setup(
    ext_modules=[recursion],
    cmdclass={
        "build_py": BuildWithData,
        "build_ext": BuildLibrary,
        "bdist_wheel": WheelForAnyPython,
    },
)
