"""GNU Octave, where this machine has it."""

import shutil

OCTAVE = shutil.which("octave-cli") or shutil.which("octave")
