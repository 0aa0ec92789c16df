"""Tables as other programs and damaged cards write them: encodings, dates, quotes, half lines."""

from __future__ import annotations

import pytest
from foreign_logs import OPTIONS, PRESSURE, read_table

from tirgeo_ros.io.logs.csv_log import read_csv
from tirgeo_ros.io.logs.forms import CSV, form_of
from tirgeo_ros.io.logs.log_contents import LogOptions

#: 07:44:39.125 UTC.
STAMP_NS = 1_718_091_879_125_000_000


@pytest.mark.parametrize("day", ["2024-06-11", "2024/6/11", "2024-06-11 00:00:00"])
def test_a_date_beside_a_time_of_day(tmp_path, day):
    columns = "time: {counts: written_utc, date: d, column: t}\npressure: {column: p, unit: Pa}\n"
    (sample,) = read_table(tmp_path, f"d,t,p\n{day},07:44:39.125,1e5\n", columns).samples
    assert sample.stamp_ns == STAMP_NS


@pytest.mark.parametrize("cell", ["1e999999", "-1e99999", "inf", "nan", "1718091879,125"])
def test_what_is_no_time_costs_its_row(tmp_path, cell):
    contents = read_table(tmp_path, f't,p\n"{cell}",1e5\n1,1e5\n', PRESSURE)
    assert len(contents.samples) == 1
    ((_, reason),) = contents.refused
    assert reason.startswith("time.column is not a number")
    assert ("decimal comma" in reason) == ("," in cell)


@pytest.mark.parametrize(
    ("encoding", "separator"),
    [("utf-8", ";"), ("utf-16", "\t"), ("utf-16-le", ";"), ("cp1252", ";")],
)
def test_a_table_of_a_german_excel(tmp_path, encoding, separator):
    """It writes a decimal comma, and degrees and squares in Windows-1252 or UTF-16."""
    rows = ["Zeit", "Höhe²", "Druck [°]"], ["1718091879,125", "9,5", "1013,25"]
    text = "\ufeff" * (encoding == "utf-16-le") + "\n".join(map(separator.join, rows))
    (tmp_path / "log.csv").write_bytes(text.encode(encoding))
    (tmp_path / "columns.yaml").write_text(
        f"table: {{separator: {'tab' if separator != ';' else 'semicolon'}, decimal: comma}}\n"
        "time: {counts: utc, column: Zeit, unit: s}\n"
        "pressure: {column: 'Druck [°]', unit: hPa}\n",
        encoding="utf-8",
    )
    path = tmp_path / "log.csv"
    assert form_of(path, columns=True) is CSV
    (sample,) = read_csv(path, LogOptions(columns=tmp_path / "columns.yaml")).samples
    assert (sample.stamp_ns, sample.pressure_pa) == (STAMP_NS, pytest.approx(101325))


def test_a_half_line_does_not_tell_the_begin(tmp_path):
    """A recording that began in the middle of a line has another number in the first column."""
    columns = "time: {counts: start, column: 1, unit: s}\npressure: {column: 3, unit: Pa}\n"
    contents = read_table(
        tmp_path, "1013,2\n5123.5,7,2\n5124.5,7,2\n", "table: {header: false}\n" + columns
    )
    begun_ns = OPTIONS.start_ns
    assert [sample.stamp_ns for sample in contents.samples] == [begun_ns, begun_ns + 10**9]


def test_zero_bytes_cost_their_row(tmp_path):
    """A memory card has them where the power went."""
    rows = "".join(f"{k},1e5\n" for k in range(1, 200))
    contents = read_table(tmp_path, f"t,p\n{rows}".replace("\n7,1e5", "\n7,1\0e5"), PRESSURE)
    assert form_of(tmp_path / "log.csv", columns=True) is CSV
    assert len(contents.samples) == 198
    assert contents.refused == {("pressure", "pressure.column is not a number"): 1}


def test_empty_cells_are_called_so(tmp_path):
    """As those of a receiver between its fixes, in a table of an IMU."""
    contents = read_table(tmp_path, "t,p\n1,2\n2, \n", PRESSURE)
    assert contents.refused == {("pressure", "pressure.column is empty"): 1}


def test_a_quote_that_is_not_closed_costs_its_row(tmp_path):
    columns = 'time: {counts: utc, column: t, unit: s}\npressure: {column: "p\\n(Pa)", unit: Pa}\n'
    table = 't,"p\n(Pa)",note\n1,1e5,"a, b"\n2,"1e5,\n3,1e5,5" lens\n4,1e5,\n'
    contents = read_table(tmp_path, table, columns)
    assert [sample.stamp_ns // 10**9 for sample in contents.samples] == [1, 3, 4]
    assert contents.refused.total() == 1
