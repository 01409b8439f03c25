"""Files as machines write them, of our own making: one simulated test in every layout."""

import gzip
import io
import tempfile
import zipfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

GRAVITY = 9.80665  # m/s2


@dataclass(frozen=True, eq=False)
class Pressed:
    """A test with its approach: time (s), displacement (mm, zero at contact), force (N)."""

    time: np.ndarray
    way: np.ndarray
    load: np.ndarray


def pressed(approach=0.4, depth=1.2, speed=2.0, hold=2.0, rate=200.0, seed=1, noise=0.002):
    """A pad of exponential law and one relaxation mode, approached and pressed, then held.

    Stepped by exponential integration of dq = K dd - v q dt between the samples.
    """
    m, b, c, v = 0.4, 1.1, 0.6, 3.0
    ramp = (approach + depth) / speed
    time = np.arange(int(rate * (ramp + hold))) / rate
    way = np.minimum(time * speed - approach, depth)
    touched = np.maximum(way, 0.0)
    elastic = m / b * np.expm1(b * touched)
    q, load = 0.0, []
    for k, step in enumerate(np.diff(elastic, prepend=0.0)):
        q = (q + step) * np.exp(-v / rate) if k else 0.0
        load.append((1.0 - c) * elastic[k] + c * q)
    rng = np.random.default_rng(seed)
    return Pressed(time, way, np.array(load) + rng.normal(0.0, noise, len(time)))


@dataclass(frozen=True)
class Fixture:
    """A layout's file: whose, and how a test is written in it.

    ``zero`` (mm) is added to the displacement; ``signs`` of displacement and force as written;
    ``digits`` of the numbers, in mm and N, bound what reading back can lose; ``tests`` written.
    """

    format: str
    name: str
    make: Callable[["Pressed"], bytes]
    signs: tuple[int, int] = (1, 1)
    digits: float = 1e-5
    tests: int = 1
    needs: str = ""


def _lines(rows, form, end="\n"):
    return "".join(form % tuple(row) + end for row in rows)


def _columns(test, way=1.0, load=1.0, zero=0.0):
    return np.stack([test.time, (test.way + zero) * way, test.load * load], axis=1)


def _commas(text):
    return text.replace(".", ",")


def bluehill_3(test):
    rows = _lines(_columns(test, -1, -1, 3.0), '"%.5f","%.6f","%.6f"', "\r\n")
    head = '"General : Start time","Wed, October 24, 2018 17:38:51"\r\n"Specimen label","pad B"\r\n'
    return (head + '\r\n"Time","Extension","Load"\r\n"(s)","(mm)","(N)"\r\n' + rows).encode()


def bluehill_3_commas(test):
    """Decimal commas, quoted, within commas."""
    rows = _commas_rows(_columns(test))
    head = "Time,Compressive extension,Compressive load\n(s),(mm),(N)\n"
    return (head + rows).encode()


def _commas_rows(table):
    cells = [[f'"{_commas(f"{value:.6f}")}"' for value in row] for row in table]
    return "".join(",".join(row) + "\n" for row in cells)


def bluehill_3_kilo(test):
    rows = _lines(_columns(test, 1.0, 1e-3), "%.5f;%.6f;%.9f")
    return ("Zeit;Weg;Kraft\n(s);(mm);(kN)\n" + _commas(rows)).encode("cp1252")


def bluehill_universal(test):
    head = 'Results Table 1\n,"Maximum Force (N)"\n1,0.7\n\nRaw Data\n'
    rows = _lines(_columns(test, zero=-0.2), '"%.5f","%.6f","%.6f"')
    return (head + '"Time (s)","Displacement (mm)","Force (N)"\n' + rows).encode()


def bluehill_universal_utf16(test):
    head = "Raw Data\r\nTime (s),Displacement (mm),Force (N),Strain 1 (%)\r\n"
    rows = _lines(np.column_stack([_columns(test), test.way * 5]), "%.5f,%.6f,%.6f,%.4f", "\r\n")
    return (head + rows).encode("utf-16")


def wintest(test):
    head = '"C:\\data\\run.txt"\0\r\n\r\n'
    names = '"Points","Elapsed Time","Disp","Load",\r\n" ","Sec","mm","N",\r\n'
    rows = np.column_stack([np.arange(len(test.time)), _columns(test, -1, -1)])
    return (head + names + _lines(rows, "%d, %.5f, %.6f, %.6f,", "\r\n")).encode()


def wintest_scans(test):
    """Two scans, the header before each, and a header left over."""
    names = '"Elapsed Time","Load","Disp",\n"Sec","N","mm",\n'
    bodies = [_lines(_columns(test)[::k, [0, 2, 1]], "%.5f, %.6f, %.6f,") for k in (1, 2)]
    return (names + bodies[0] + names + bodies[1] + names).encode()


def testsuite(test):
    head = '"File Path: C:\\MTS\\run.csv"\r\n"Test: compression"\r\n"Test Run: pad 7"\r\n'
    head += '"Date: 2024-03-01 10:00:00"\r\n\r\n\r\n'
    head += '"Running Time   ","Axial Displacement ","Axial Force   "\r\n"sec","mm","kN"\r\n'
    rows = _lines(_columns(test, -1, -1e-3, 12.0), "%.5f,%.6f,%.9f", "\r\n")
    return b"\xef\xbb\xbf" + (head + rows).encode()


def testsuite_tabs(test):
    head = "Test:\trelaxation\nTest Run Name:\tpad 8\nDate:\t3/1/2024 10:00:00 AM\n\n"
    head += "Time\tCrosshead\tLoad\tInput\nsec\tmm\tN\tV\n"
    rows = np.column_stack([_columns(test, -1, -1), test.load])
    return (head + _lines(rows, "%.5f\t%.6f\t%.6f\t%.3f")).encode()


def testxpert(test):
    """Rows from before the approach, uneven sampling, German, Windows letters."""
    keep = np.r_[0 : len(test.time) : 3]
    keep = np.union1d(keep, np.arange(len(test.time) // 3))
    table = _columns(Pressed(test.time[keep], test.way[keep], test.load[keep]), 1.0, 1.0, 5.0)
    head = '"Prüfnorm";"eigene"\r\n"Prüfer";"M"\r\n"Datum";"01.03.2024 10:00:00"\r\n'
    head += '"Prüfzeit";"Standardweg";"Standardkraft"\r\n"s";"mm";"N"\r\n'
    rows = _lines(table[:, [0, 1, 2]], "%.5f;%.6f;%.6f", "\r\n")
    return head.encode("cp1252") + _commas(rows).encode()


def testxpert_english(test):
    head = "Specimen\t3\nTest time [s]\tStandard force [N]\tStandard travel [mm]\n"
    return (head + _lines(_columns(test)[:, [0, 2, 1]], "%.5f\t%.6f\t%.6f")).encode()


def table_below(test):
    """As a rheometer writes it: units below an empty row, cells of text, UTF-16."""
    head = "Interval data:\tPoint\tTime\tDisplacement\tNormal force\tForce\tStatus\r\n\r\n"
    head += "\t\t[s]\t[mm]\t[N]\t[N]\t\r\n"
    columns = np.column_stack([np.arange(len(test.time)), _columns(test), test.load])
    rows = _lines(columns, "\t%d\t%.5f\t%.6f\t%.6f\t%.6f\tok", "\r\n")
    return ("Test:\tpad\r\n" + head + _commas(rows)).encode("utf-16")


def table_spanish(test):
    names = "Tiempo [s];Desplazamiento [mm];Fuerza axial [N]\n"
    return (names + _commas(_lines(_columns(test), "%.5f;%.6f;%.6f"))).encode("cp1252")


def _workbook(sheets):
    import openpyxl

    book = openpyxl.Workbook()
    book.remove(book.active)
    for title, rows in sheets.items():
        sheet = book.create_sheet(title)
        for row in rows:
            sheet.append(row)
    out = io.BytesIO()
    book.save(out)
    return out.getvalue()


def testxpert_excel(test):
    table = _columns(test).tolist()
    head = [["Probe 1"], ["Prüfzeit", "Standardweg", "Standardkraft"], ["s", "mm", "N"]]
    results = [["Probe", "Fmax"], ["", "N"], [1, 0.7]]
    mean = [["Mittelwertprobe"], *head[1:], *table]
    return _workbook({"Ergebnisse": results, "Probe 1": head + table, "Mittelwertprobe": mean})


FRENCH = ("Temps d'essai", "Allongement", "Force standard")


def workbook(path, titles, above=()):
    """A French workbook of testXpert: a sheet with a test for each title."""
    head = [list(FRENCH), ["s", "mm", "N"]]
    sheets = {}
    for seed, title in enumerate(titles):
        table = np.stack([(t := pressed(seed=seed)).time, t.way, t.load], axis=1).tolist()
        sheets[title] = [[above or title], *head, *table]
    path.write_bytes(_workbook(sheets))
    return path


def testxpert_excel_english(test):
    table = _columns(test, -1, -1).tolist()
    head = [["Test time [s]", "Standard travel [mm]", "Standard force [N]"]]
    return _workbook({"Specimen 1": head + table, "Specimen 2": head + table[::2]})


def cellscale(test):
    size = 10.0 - test.way
    head = "SetName,Cycle,Time_S,Size_mm,Displacement_mm,Force_N\n"
    rows = np.column_stack([test.time, size, test.way, test.load])
    return (head + _lines(rows, "press,1-Compress,%.5f,%.6f,%.6f,%.6f")).encode()


def cellscale_micro(test):
    head = "Set Name,Cycle,Time (S),Force (uN),Tip (um),Base (um),Size (um),Temp (C)\r\n"
    rows = np.column_stack(
        [test.time, test.load * 1e6, test.way * 1e3, test.way * 1e3 + 2, 5e3 - test.way, test.time]
    )
    form = "1,Compress 1,%.5f,%.3f,%.4f,%.4f,%.3f,%.1f"
    return (head + _lines(rows, form, "\r\n")).encode()


def mach_1(test):
    info = "<Mach-1 File>\r\n<INFO>\r\nDate:\t2024-03-01\r\nTime:\t10:00:00.000\r\n"
    info += "<Find Contact>\r\n<END INFO>\r\n"
    names = "<DATA>\r\nTime, s\tPosition (z), mm\tPosition (x), mm\tFz, gf\r\n"
    rows = np.column_stack([test.time, test.way + 7.0, 0 * test.time, -test.load * 1e3 / GRAVITY])
    body = _lines(rows, "%.5f\t%.6f\t%.3f\t%.5f", "\r\n")
    return (info + names + body + "<END DATA>\r\n").encode()


def mach_1_blocks(test):
    """Two functions; a mark between the parts of one; the last block is not closed."""
    first = mach_1(test).decode().replace("Fz, gf", "Fz, N").replace("gf", "N")
    table = np.column_stack([test.time, test.way, -test.load])
    body = _lines(table[:300], "%.5f\t%.6f\t%.6f") + "<divider>\n"
    body += _lines(table[300:], "%.5f\t%.6f\t%.6f")
    again = "<INFO>\nDate:\t2024-03-01\nTime:\t10:05:00\n<Stress Relaxation>\n<END INFO>\n"
    again += "<DATA>\nTime, s\tPosition (z), mm\tFz, N\n" + body
    short = (
        "<INFO>\n<Move Relative>\n<END INFO>\n<DATA>\nTime, s\tPosition (z), mm\tFz, N\n0\t0\t0\n"
    )
    first = _newtons(test)
    return (first + short + "<END DATA>\n" + again).encode()


def _newtons(test):
    rows = _lines(np.column_stack([test.time, test.way, -test.load]), "%.5f\t%.6f\t%.6f")
    info = "<Mach-1 File>\n<INFO>\nDate:\t2024-03-01\nTime:\t10:00:00\n<Ramp>\n<END INFO>\n"
    return info + "<DATA>\nTime, s\tPosition (z), mm\tFz, N\n" + rows + "<END DATA>\n"


_CHIARO = (
    "Date\t01/03/2024\tTime\t10:00:00\tStatus\tok\nmatrix\nScan (#)\t1\tX (#)\t1\tY (#)\t1\n"
    "X-position (um)\t0.0\n\nk (N/m)\t4.2\n\nTip radius (um)\t50\n\n"
    "Piezo Indentation Sweep Settings (Relative to piezo position setpoint at start):\n"
    "D[Z1] (nm)\t9000.0\tt[1] (s)\t2.0\n\n"
)
_CHIARO_NAMES = "Time (s)\tLoad (uN)\tIndentation (nm)\tCantilever (nm)\tPiezo (nm)\tAuxiliary\n"


def chiaro(test):
    rows = np.column_stack(
        [test.time, test.load * 1e6, test.way * 1e6, test.load, test.way, 0 * test.time]
    )
    return (_CHIARO + _CHIARO_NAMES + _lines(rows, "%.5f\t%.2f\t%.1f\t%.3f\t%.3f\t%.0f")).encode()


def chiaro_windows(test):
    return chiaro(test).replace(b"\n", b"\r\n").replace(b"ok", "läuft".encode("cp1252"))


def tdms(test, names=("Time", "Position", "Load"), units=("s", "mm", "N")):
    from nptdms import ChannelObject, TdmsWriter

    out = io.BytesIO()
    channels = [
        ChannelObject("Run 1", name, values, properties={"unit_string": unit})
        for name, values, unit in zip(names, (test.time, -test.way, -test.load), units, strict=True)
    ]
    with TdmsWriter(out) as writer:
        writer.write_segment(channels)
    return out.getvalue()


def tdms_waveforms(test):
    """No channel of time: the waveforms tell their increment."""
    from nptdms import ChannelObject, TdmsWriter

    out = io.BytesIO()
    step = float(test.time[1] - test.time[0])
    channels = [
        ChannelObject("a", name, values, properties={"wf_increment": step, "unit_string": unit})
        for name, values, unit in (
            ("Displacement", test.way * 1e3, "um"),
            ("Force", test.load * 1e3, "mN"),
            ("Trigger", 0 * test.load, "V"),
        )
    ]
    with TdmsWriter(out) as writer:
        writer.write_segment(channels)
    return out.getvalue()


def matlab(test):
    from scipy.io import savemat

    out = io.BytesIO()
    named = {"time_s": test.time, "displacement_mm": test.way, "force_N": test.load, "note": "a"}
    savemat(out, named)
    return out.getvalue()


def matlab_structs(test):
    from scipy.io import savemat

    out = io.BytesIO()
    run = {"time_ms": 1e3 * test.time, "disp_um": -1e3 * test.way, "load_mN": 1e3 * test.load}
    second = {name: values[::2] for name, values in run.items()}
    savemat(out, {"run1": run, "run2": second}, do_compression=True)
    return out.getvalue()


def matlab_73(test):
    """HDF5 below 512 bytes in which MATLAB says its name."""
    body = _hdf5({"time_s": test.time, "displacement_mm": test.way, "force_N": test.load}, 512)
    return b"MATLAB 7.3 MAT-file, by a test".ljust(512, b" ") + body[512:]


def _hdf5(named, block=0, units=None):
    import h5py

    out = io.BytesIO()
    with h5py.File(out, "w", userblock_size=block) as file:
        for name, values in named.items():
            file[name] = values
            if units:
                file[name].attrs["units"] = units[name]
    return out.getvalue()


def hdf5(test):
    named = {"run/t": test.time, "run/depth": test.way, "run/F": test.load, "run/note": [1, 2, 3]}
    named = {
        "run/time": named["run/t"],
        "run/depth": named["run/depth"],
        "run/force": named["run/F"],
    }
    units = {"run/time": "s", "run/depth": "mm", "run/force": "N"}
    return _hdf5(named, units=units)


def hdf5_groups(test):
    runs = {}
    for k, run in enumerate(("a", "b"), 1):
        runs |= {
            f"{run}/time_s": test.time[None, ::k],
            f"{run}/displacement_um": -1e3 * test.way[None, ::k],
            f"{run}/force_mN": 1e3 * test.load[None, ::k],
        }
    return _hdf5(runs)


def afm_jpk(test):
    """An approach and a retraction of a cantilever of 1 N/m, in JPK's zip of integers."""
    half = len(test.time) // 2
    stiffness, grain = 1.0, 1e-14  # N/m; m and N in one count
    force = test.load * 1e-9  # N to nN
    height = -(test.way * 1e-9) - force / stiffness
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr("header.properties", _jpk_header())
        archive.writestr("segments/", "")
        for k, part in enumerate((slice(0, half), slice(half, None))):
            seconds = float(test.time[1] - test.time[0]) * len(test.time[part])
            style = ("extend", "retract")[k]
            archive.writestr(f"segments/{k}/", "")
            text = _jpk_segment(style, len(test.time[part]), seconds, stiffness, grain)
            archive.writestr(f"segments/{k}/segment-header.properties", text)
            for name, values in (("vDeflection", force), ("measuredHeight", height)):
                counts = np.round(values[part] / grain).astype(">i4").tobytes()
                archive.writestr(f"segments/{k}/channels/{name}.dat", counts)
    return out.getvalue()


def _jpk_header():
    return "file-format-version=0.12\nforce-scan-series.header.position.x=0.0\n"


def _jpk_segment(style, count, seconds, stiffness, grain):
    lines = {
        "force-segment-header.num-points": count,
        "force-segment-header.duration": seconds,
        "force-segment-header.approach-id": "a",
        "force-segment-header.time-stamp": "2024-03-01 10:00:00.000 +0000",
        "force-segment-header.settings.style": style,
        "force-segment-header.settings.segment-settings.duration": seconds,
        "force-segment-header.settings.segment-settings.style": style,
        "force-segment-header.settings.segment-settings.z-start": 0.0,
        "force-segment-header.settings.segment-settings.z-end": 1e-6,
        "force-segment-header.environment.xy-scanner-position-map.xy-scanner.tip-scanner."
        "position-index": 0,
        "force-scan-series.header.position-index": 0,
    }
    for name, slots in (("vDeflection", ("distance", "force")), ("measuredHeight", ("nominal",))):
        base = f"channel.{name}"
        lines |= {
            f"{base}.data.encoder.type": "signedinteger",
            f"{base}.data.encoder.scaling.multiplier": grain,
            f"{base}.data.encoder.scaling.offset": 0.0,
            f"{base}.data.encoder.scaling.unit.unit": "V",
            f"{base}.conversion-set.conversions.base": "volts",
            f"{base}.conversion-set.conversions.default": slots[-1],
        }
        before = "volts"
        for slot in slots:
            own = f"{base}.conversion-set.conversion.{slot}"
            lines |= {
                f"{own}.name": slot,
                f"{own}.base-calibration-slot": before,
                f"{own}.scaling.offset": 0.0,
                f"{own}.scaling.multiplier": stiffness,
                f"{own}.scaling.unit.unit": "N" if slot == "force" else "m",
            }
            before = slot
    return "".join(f"{key}={value}\n" for key, value in lines.items())


def afm_table(test):
    """afmformats' own table."""
    import json

    meta = {"spring constant": 2.0, "imaging mode": "force-distance", "enum": 0}
    meta |= {"point count": len(test.time), "path": "a.tab"}
    head = "# afmformats 0.18\n# BEGIN METADATA\n"
    head += "".join(f"# {line}\n" for line in json.dumps(meta, indent=1).split("\n"))
    names = ["force", "height (measured)", "segment", "time"]
    force = test.load * 1e-9
    height = -(test.way * 1e-9) - force / 2.0
    segment = (np.arange(len(test.time)) >= len(test.time) // 2).astype(int)
    rows = "".join(
        f"{f:.9e}\t{h:.9e}\t{s}\t{t:.6f}\n"
        for f, h, s, t in zip(force, height, segment, test.time, strict=True)
    )
    return (head + "# END METADATA\n#\n# " + "\t".join(names) + "\n" + rows).encode()


_LVM = (
    "LabVIEW Measurement\t\nWriter_Version\t2\nSeparator\tTab\nDecimal_Separator\t.\n"
    "X_Columns\t{columns}\nDate\t2024/05/03\n***End_of_Header***\t\n\t\nChannels\t2\t\t\n"
    "Samples\t{size}\t{size}\t\nY_Unit_Label\tNewtons\tMillimeters\t\nX_Dimension\tTime\tTime\t\n"
    "X0\t0.0E+0\t0.0E+0\t\nDelta_X\t{step:.6E}\t{step:.6E}\t\n***End_of_Header***\t\t\t\n"
    "X_Value\tForce\tDisplacement\tComment\n"
)


def lvm(test):
    """LabVIEW's text without a column of time, which its header gives."""
    head = _LVM.format(columns="No", size=len(test.time), step=test.time[1] - test.time[0])
    return (head + _lines(_columns(test)[:, [2, 1]], "\t%.6f\t%.6f")).encode()


def lvm_times(test):
    head = _LVM.format(columns="One", size=len(test.time), step=test.time[1] - test.time[0])
    names = head.replace("Force\tDisplacement", "Untitled\tUntitled 1")
    return (names + _lines(_columns(test)[:, [0, 2, 1]], "%.5f\t%.6f\t%.6f")).encode()


LAG = 0.0042  # s, by which the force's clock is behind


def two_clocks(test):
    way = np.interp(test.time - LAG, test.time, test.way)
    rows = np.column_stack([test.time - LAG, way, test.time, test.load])
    return ("t_disp_s,disp_mm,t_force_s,force_N\n" + _lines(rows, "%.6f,%.6f,%.6f,%.6f")).encode()


def two_clocks_tidy(test):
    """A tidy header, and next to it the force's own clock: taken for tidy, the force would lag."""
    way = np.interp(test.time - LAG, test.time, test.way)
    rows = np.column_stack([test.time - LAG, way, -test.load * 1e3, 1e3 * test.time])
    head = "# rig 2\ntime_s,displacement_mm,force_mN,time_force_ms\n"
    return (head + _lines(rows, "%.6f,%.6f,%.4f,%.4f")).encode()


EPOCH = 1_750_000_000  # s since 1970, of a robot's clock


def _posed(test):
    """Stamps and heights of a platen, 250 times a second from before the test to after it."""
    time = np.arange(-0.0087, test.time[-1] + 0.01, 0.004)
    return time, np.interp(time, test.time, test.way)


def ros_table(test):
    """Topics side by side, each row of one of them, with the frame's name; noise across."""
    head = (
        "/ft.header.stamp.sec,/ft.header.stamp.nanosec,/ft.header.frame_id,/ft.wrench.force.x,"
        "/ft.wrench.force.z,/tool.header.stamp.sec,/tool.header.stamp.nanosec,"
        "/tool.pose.position.x,/tool.pose.position.z\n"
    )
    rows = [
        (t, f"{EPOCH + int(t)},{round(t % 1 * 1e9)},tool0,{0.01 * f:.6f},{-f:.6f},,,,\n")
        for t, f in zip(test.time, test.load, strict=True)
    ]
    rows += [
        (t, f",,,,,{EPOCH + int(t // 1)},{round(t % 1 * 1e9)},{1e-5 * d:.9f},{-1e-3 * d:.9f}\n")
        for t, d in zip(*_posed(test), strict=True)
    ]
    return (head + "".join(row for _, row in sorted(rows))).encode()


def ros_table_plain(test):
    """One stamp for both, fields with a leading point, as of a bag that was resampled."""
    head = "header.stamp.sec,header.stamp.nanosec,.wrench.force.z,.pose.position.z\n"
    cells = zip(test.time, test.load, test.way, strict=True)
    return (
        head
        + "".join(
            f"{EPOCH + int(t)},{round(t % 1 * 1e9)},{f:.6f},{1e-3 * d:.9f}\n" for t, f, d in cells
        )
    ).encode()


def ros_table_plotjuggler(test):
    """Slashes, one clock in seconds for all rows, and empty cells."""
    rows = [(t, f"{EPOCH + t:.7f},{f:.6f},\n") for t, f in zip(test.time, test.load, strict=True)]
    rows += [(t, f"{EPOCH + t:.7f},,{1e-3 * d:.9f}\n") for t, d in zip(*_posed(test), strict=True)]
    head = "__time,/ft/wrench/force/z,/tool/pose/position/z\n"
    return (head + "".join(row for _, row in sorted(rows))).encode()


def _bag(test, suffix, *, joints=False):
    """A bag of a wrench and of a pose, or of two joints; with the files' own definitions."""
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    first = suffix == ".bag"  # of ROS 1, whose headers count the messages too
    store = get_typestore(Stores.ROS1_NOETIC if first else Stores.LATEST)
    kinds, serialized = store.types, store.serialize_ros1 if first else store.serialize_cdr

    def header(time):
        sec, fine = divmod(EPOCH * 10**9 + round(1e9 * time), 10**9)
        stamp = kinds["builtin_interfaces/msg/Time"](sec, fine)
        return kinds["std_msgs/msg/Header"](*([0] if first else []), stamp, "tool0")

    def vector(kind, z):
        return kinds[f"geometry_msgs/msg/{kind}"](0.01 * z, 0.0, z)

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"bag{suffix}"
        if first:
            writer = rosbag1.Writer(path)
        else:
            plugin = (
                rosbag2.StoragePlugin.MCAP if suffix == ".mcap" else rosbag2.StoragePlugin.SQLITE3
            )
            writer = rosbag2.Writer(path, version=9, storage_plugin=plugin)
        with writer as bag:

            def topic(name, kind, messages):
                link = bag.add_connection(name, kind, typestore=store)
                for time, fields in messages:
                    message = kinds[kind](header(time), *fields)
                    received = EPOCH * 10**9 + round(1e9 * time) + 2_000_000  # 2 ms later
                    bag.write(link, received, serialized(message, kind))

            wrench = kinds["geometry_msgs/msg/Wrench"]
            loads = (
                (t, [wrench(vector("Vector3", f), vector("Vector3", 0.0))])
                for t, f in zip(test.time, test.load, strict=True)
            )
            topic("/ft", "geometry_msgs/msg/WrenchStamped", loads)
            still = kinds["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
            pose = kinds["geometry_msgs/msg/Pose"]
            posed = list(zip(*_posed(test), strict=True))
            if joints:
                empty = np.zeros(0)
                kind = "sensor_msgs/msg/JointState"
                states = (
                    (t, [["turn", "slide"], np.array([0.3, -1e-3 * d]), empty, empty])
                    for t, d in posed
                )
                topic("/joints", kind, states)
            else:
                poses = ((t, [pose(vector("Point", 1e-3 * d), still)]) for t, d in posed)
                topic("/tool", "geometry_msgs/msg/PoseStamped", poses)
        return (path if first else next(path.glob(f"*{suffix}"))).read_bytes()


def rosbag_mcap(test):
    return _bag(test, ".mcap")


def rosbag_sqlite(test):
    return _bag(test, ".db3")


def rosbag_1(test):
    return _bag(test, ".bag")


def rosbag_joints(test):
    return _bag(test, ".mcap", joints=True)


def rosbag_1_joints(test):
    return _bag(test, ".bag", joints=True)


FIXTURES = (
    Fixture("bluehill-3", "a.csv", bluehill_3, (-1, -1)),
    Fixture("bluehill-3", "b.csv", bluehill_3_commas),
    Fixture("bluehill-3", "c.csv", bluehill_3_kilo),
    Fixture("bluehill-universal", "a.csv", bluehill_universal),
    Fixture("bluehill-universal", "b.csv", bluehill_universal_utf16),
    Fixture("wintest", "a.txt", wintest, (-1, -1)),
    Fixture("wintest", "b.txt", wintest_scans, tests=2),
    Fixture("testsuite", "a.csv", testsuite, (-1, -1)),
    Fixture("testsuite", "b.txt", testsuite_tabs, (-1, -1)),
    Fixture("testxpert", "a.txt", testxpert),
    Fixture("testxpert", "b.tra", testxpert_english),
    Fixture("testxpert-excel", "a.xlsx", testxpert_excel, needs="python_calamine"),
    Fixture(
        "testxpert-excel", "b.xlsx", testxpert_excel_english, (-1, -1), 1e-5, 2, "python_calamine"
    ),
    Fixture("cellscale", "a.csv", cellscale),
    Fixture("cellscale", "b.csv", cellscale_micro),
    Fixture("mach-1", "a.txt", mach_1, (1, -1)),
    Fixture("mach-1", "b.txt", mach_1_blocks, (1, -1), tests=2),
    Fixture("chiaro", "a.txt", chiaro),
    Fixture("chiaro", "b.txt", chiaro_windows),
    Fixture("lvm", "a.lvm", lvm),
    Fixture("lvm", "b.lvm", lvm_times),
    Fixture("afm", "a.jpk-force", afm_jpk, needs="afmformats"),
    Fixture("afm", "b.tab", afm_table, needs="afmformats"),
    Fixture("tdms", "a.tdms", tdms, (-1, -1), needs="nptdms"),
    Fixture("tdms", "b.tdms", tdms_waveforms, needs="nptdms"),
    Fixture("matlab", "a.mat", matlab),
    Fixture("matlab", "b.mat", matlab_structs, (-1, 1), tests=2),
    Fixture("matlab", "c.mat", matlab_73),
    Fixture("hdf5", "a.h5", hdf5),
    Fixture("hdf5", "b.h5", hdf5_groups, (-1, 1), tests=2),
    Fixture("table", "a.csv", table_below),
    Fixture("table", "b.csv", table_spanish),
    Fixture("ros-table", "a.csv", ros_table, (-1, -1)),
    Fixture("ros-table", "b.csv", ros_table_plain),
    Fixture("ros-table", "c.csv", ros_table_plotjuggler),
    Fixture("rosbag", "a.mcap", rosbag_mcap, needs="rosbags"),
    Fixture("rosbag", "b.db3", rosbag_sqlite, needs="rosbags"),
    Fixture("rosbag", "c.bag", rosbag_1, needs="rosbags"),
    Fixture("two-clocks", "a.csv", two_clocks),
    Fixture("two-clocks", "b.csv", two_clocks_tidy, (1, -1)),
)


def zipped(data):
    """As .gz, the same bytes each time."""
    return gzip.compress(data, mtime=0)
