"""CSV files as spreadsheets, planners and editors of all kinds write them."""

from pathlib import Path

import numpy as np
import pytest

from companion.config.csv_table import read_table
from companion.config.trajectory_files import read_waypoints
from companion.core.interfaces import ConfigError

WANTED = "t_s,x_m"
ROWS = [[0.0, 0.5], [4.0, -1.25]]
GOOD = {
    "plain": b"t_s,x_m\n0,0.5\n4,-1.25\n",
    "Excel's CSV UTF-8: byte order mark, CRLF": b"\xef\xbb\xbft_s,x_m\r\n0,0.5\r\n4,-1.25\r\n",
    "Excel in most of Europe: semicolons, decimal commas": b"t_s;x_m\r\n0;0,5\r\n4;-1,25\r\n",
    "semicolons, decimal points": b"t_s;x_m\r\n0;0.5\r\n4;-1.25\r\n",
    "Excel's own hint": b"sep=;\r\nt_s;x_m\r\n0;0,5\r\n4;-1,25\r\n",
    "tabs": b"t_s\tx_m\n0\t0.5\n4\t-1.25\n",
    "tabs, decimal commas": b"t_s\tx_m\n0\t0,5\n4\t-1,25\n",
    "old Macintosh: lines end with a carriage return": b"t_s,x_m\r0,0.5\r4,-1.25\r",
    "rows emptied in the spreadsheet": b"t_s,x_m,,\n0,0.5,,\n,,,\n4,-1.25,,\n,,,\n,,,\n",
    "blank lines": b"\n\nt_s,x_m\n\n0,0.5\n   \n4,-1.25",
    "spaces": b" t_s , x_m\n  0 ,  0.5 \n4,-1.25  \n",
    "quotes around everything": b'"t_s","x_m"\n"0","0.5"\n"4","-1.25"\n',
    "quotes and decimal commas": b'"t_s";"x_m"\n"0";"0,5"\n"4";"-1,25"\n',
    "a header in capitals": b"T_S,X_m\n0,0.5\n4,-1.25\n",
    "comments on top": b"# made by planner 3\n# in W, m; z up\nt_s,x_m\n0,0.5\n4,-1.25\n",
    "comments between": b"t_s,x_m\n# out\n0,0.5\n#back\n4,-1.25\n",
    "numpy.savetxt": b"# t_s x_m\n0.000000000000000000e+00 5.0e-01\n4.0e+00 -1.25e+00\n",
    "numpy.savetxt with commas": b"# t_s,x_m\n0.0,5.0e-01\n4.0e+00,-1.25e+00\n",
    "columns of one width": b"  t_s     x_m\n  0.0     0.5\n  4.0   -1.25\n",
}


def written(folder: Path, raw: bytes) -> Path:
    path = folder / "way.csv"
    path.write_bytes(raw)
    return path


@pytest.mark.parametrize("raw", GOOD.values(), ids=GOOD.keys())
def test_what_another_program_wrote_is_read(tmp_path: Path, raw: bytes) -> None:
    table = read_table(written(tmp_path, raw), WANTED)
    assert table.header == ("t_s", "x_m")
    np.testing.assert_array_equal(table.numbers(), ROWS)


BAD = {
    b"": "is empty; the first line must be t_s,x_m",
    b"\n ,,\n": "is empty; the first line must be t_s,x_m",
    b"time|x\n0|1\n": "the first line must be t_s,x_m; it is 'time|x'",
    b"0,0.5\n4,1\n": "the first line must be t_s,x_m; it is '0,0.5'",
    b"t_s,x_m\n\n\n4,abc\n": "line 4: every value must be a number, not '4,abc'",
    b"t_s,x_m\r\r\r4,abc\r": "line 4: every value must be a number, not '4,abc'",
    b't_s,x_m\n"\n0",0\n4,abc\n': "line 4: every value must be a number, not '4,abc'",
    b"t_s,x_m\n0,#N/A\n": "line 2: every value must be a number, not '0,#N/A'",
    b"t_s,x_m\n#NUM!,1\n": "line 2: every value must be a number, not '#NUM!,1'",
    b"t_s,x_m\n1_0,1\n": "line 2: every value must be a number, not '1_0,1'",
    "t_s,x_m\n0,−1\n".encode(): "line 2: every value must be a number, not '0,−1'",
    b"t_s,x_m\n0,nan\n": "line 2: every value must be finite, not '0,nan'",
    b"t_s,x_m\n0,1e999\n": "line 2: every value must be finite, not '0,1e999'",
    b"t_s,x_m\n0,1\n4,\n": "line 3: 2 values are needed, there are 1",
    b"t_s,x_m\n0,0,5\n": (
        "line 2: 2 values are needed, there are 3: are there decimal commas? Separate the columns by ';'"
    ),
    b't_s,x_m\n"1,234",5\n': "line 2: every value must be a number, not '1,234,5'",
    b"t_s;x_m\n0;0.5\n4;1,5\n": "line 3 has a comma in a number, line 2 a point: which is decimal?",
    b't_s,x_m\n0,"1\n4,2\n': "line 2: cannot be read as CSV: unexpected end of data",
    b"t_s,x_m\n0,1\n# B\xf6schung\n4,2\n": "line 3: the byte 0xf6 is no UTF-8: save it as UTF-8",
    "t_s,x_m\n0,1\n".encode("utf-16"): "is UTF-16 or no text at all: save it as UTF-8",
    "t_s,x_m\n0,1\n".encode("utf-16-be"): "is UTF-16 or no text at all: save it as UTF-8",
    b"PK\x03\x04\x14\0\x06": "is UTF-16 or no text at all: save it as UTF-8",
    b"time," + b"x" * 100: f"the first line must be t_s,x_m; it is 'time,{'x' * 52}...'",
    b"t_s,x_m\n" + b" " * 1_000_000: "is larger than 1 MB, which is too much for such a file",
}


@pytest.mark.parametrize("raw", BAD, ids=[str(raw[:24]) for raw in BAD])
def test_what_cannot_be_read_is_named_with_its_line(tmp_path: Path, raw: bytes) -> None:
    path = written(tmp_path, raw)
    with pytest.raises(ConfigError) as caught:
        read_table(path, WANTED).numbers()
    assert str(caught.value) == f"{path}: {BAD[raw]}"


def test_the_line_of_a_time_that_falls_is_that_of_the_file(tmp_path: Path) -> None:
    path = written(tmp_path, b"# path\n\nt_s,x_m,y_m,z_m\n0,0,0,1\n\n\n4,0,0,1\n4,0,1,1\n")
    with pytest.raises(ConfigError, match=r"way\.csv: line 8: t_s must rise, 4 does not follow 4"):
        read_waypoints(path)


def test_a_folder_and_a_file_that_is_not_there_are_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="is a folder: give the name of a file"):
        read_table(tmp_path, WANTED)
    with pytest.raises(ConfigError, match="there is no such file"):
        read_table(tmp_path / "none.csv", WANTED)
