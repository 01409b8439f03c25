"""Make the fonts of figures: python docs/building/fonts.py.

They are DejaVu Sans with the signs that figures use. A PDF holds the letters that it needs, and
Matplotlib cuts them out of the whole font for each file. Out of these small fonts that takes a
fraction of the time. Other signs come from the whole font.
"""

from pathlib import Path

import matplotlib
from fontTools import subset
from fontTools.ttLib import TTFont

FONTS = Path(__file__).parents[2] / "qlvbayes" / "plots" / "fonts"
NAME = "qlvbayes Sans"
# Latin, accents, Greek, punctuation, indices, arrows, mathematics, shapes, check marks
SIGNS = (
    (0x20, 0x17F), (0x2B0, 0x2FF), (0x370, 0x3FF), (0x2010, 0x2027), (0x2030, 0x205E),
    (0x2070, 0x209C), (0x2190, 0x21FF), (0x2200, 0x2265), (0x25A0, 0x25FF), (0x2713, 0x2718),
)  # fmt: skip


def main() -> None:
    """Write both weights, renamed, and their licence."""
    whole = Path(matplotlib.get_data_path()) / "fonts" / "ttf"
    for source, weight in (("DejaVuSans", "Regular"), ("DejaVuSans-Bold", "Bold")):
        options = subset.Options(layout_features=["kern"], hinting=False, glyph_names=False)
        options.drop_tables += ["GSUB", "GDEF", "FFTM", "gasp"]
        font, cut = TTFont(whole / f"{source}.ttf"), subset.Subsetter(options)
        cut.populate(unicodes=[sign for first, last in SIGNS for sign in range(first, last + 1)])
        cut.subset(font)
        names = {1: NAME, 4: f"{NAME} {weight}", 6: f"qlvbayesSans-{weight}", 16: NAME}
        for record in font["name"].names:
            record.string = names.get(record.nameID, record.toUnicode())
        font.save(FONTS / f"qlvbayesSans-{weight}.ttf")
    (FONTS / "LICENSE_DEJAVU").write_bytes((whole / "LICENSE_DEJAVU").read_bytes())


if __name__ == "__main__":
    main()
