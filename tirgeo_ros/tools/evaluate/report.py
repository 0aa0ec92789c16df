"""Write an evaluation as one self-contained page: tables, figures and stills."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

from tirgeo_ros import __version__
from tirgeo_ros.tools.evaluate.flight_plots import flight_plots
from tirgeo_ros.tools.evaluate.ground_plots import ground_plots
from tirgeo_ros.tools.evaluate.plot import Plot
from tirgeo_ros.tools.evaluate.result import Evaluation, MethodResult, Still
from tirgeo_ros.tools.evaluate.verdict import verdict

_STYLE = """
:root { color-scheme: light; }
* { box-sizing: border-box; }
body { font: 16px/1.5 system-ui, sans-serif; color: #1a1a1a; background: #fff;
  max-width: 62rem; margin: 1.5rem auto; padding: 0 1rem; }
h1 { font-size: 1.6rem; margin-bottom: .2rem; overflow-wrap: anywhere; }
h2 { font-size: 1.2rem; margin-top: 2.2rem; border-bottom: 1px solid #ddd; }
.lead { color: #555; margin-top: 0; overflow-wrap: anywhere; }
.verdict { font-size: 1.15rem; font-weight: 600; overflow-wrap: anywhere; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; margin: .6rem 0; }
th, td { padding: .15rem .7rem; text-align: right; border-bottom: 1px solid #eee;
  white-space: nowrap; }
th:first-child, td:first-child { text-align: left; position: sticky; left: 0; background: #fff; }
thead th, tfoot th { border-bottom: 2px solid #999; }
tfoot th { border-bottom: 0; border-top: 2px solid #999; }
.wide { overflow-x: auto; }
figure { margin: 1.2rem 0; }
figure img { width: 100%; height: auto; display: block; }
figcaption { color: #555; font-size: .9rem; overflow-wrap: anywhere; }
.note { background: #fff6df; border-left: 4px solid #e69f00; padding: .4rem .8rem; }
.fault { background: #fdeaea; border-left: 4px solid #c0392b; padding: .4rem .8rem; }
.side { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 22rem), 1fr));
  gap: 1rem; }
.side > img:only-child { max-width: 34rem; }
.side figure { margin: 0; }
summary { cursor: pointer; }
pre { overflow-x: auto; font-size: .85rem; }
@media (max-width: 30rem) {
  body { padding: 0 .7rem; }
  th, td { padding: .15rem .2rem; font-size: .74rem; white-space: normal; }
}
"""


def report_html(found: Evaluation) -> str:
    """Return the page."""
    parts = [
        f"<h1>Ground points of {escape(Path(found.bag).name)}</h1>",
        f'<p class="verdict">{escape(verdict(found.methods))}</p>',
        f'<p class="lead">{_lead(found)}</p>',
        *_remarks(found),
        "<h2>By method</h2>",
        _methods_table(found),
        "<h2>Paired t-test</h2>",
        _tests_table(found),
        "<h2>By control point</h2>",
        _points_table(found),
        *[_figure(plot) for plot in (*ground_plots(found), *flight_plots(found))],
        *_stills(found.stills),
        "<h2>Parameters as used</h2>",
        *[_parameters(method) for method in found.methods],
    ]
    body = "\n".join(parts)
    title = f"tirgeo: ground points of {escape(Path(found.bag).name)}"
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{title}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n{body}\n"
        f'<p class="lead">tirgeo {__version__}</p>\n</body>\n</html>\n'
    )


def _lead(found: Evaluation) -> str:
    """Return what was compared with what, and where."""
    checks = found.checks
    seen = sum(name not in checks.unobserved_ids for name in found.control)
    ground = found.methods[0].ground_words if found.methods else ""
    words = [
        f"{checks.observations} observations",
        f"{seen} of {len(found.control)} surveyed points observed",
        f"survey {found.survey_path}",
        f"observations {found.observations_path}",
        f"errors in {found.projection.name}",
        ground,
    ]
    return escape("; ".join(word for word in words if word)) + "."


def _remarks(found: Evaluation) -> list[str]:
    faults = [] if found.error is None else [found.error]
    missing = [f"{method} could not be run: {why}" for method, why in found.faults.items()]
    return [
        *[f'<p class="fault">{escape(text)}</p>' for text in faults],
        *[f'<p class="note">{escape(text)}</p>' for text in missing],
        *(["<ul>", *(f"<li>{escape(text)}</li>" for text in found.notes), "</ul>"]),
    ]


def _methods_table(found: Evaluation) -> str:
    head = ("", *[method.method for method in found.methods])
    measures = (
        "mean of the points, m", "rmse, m", "CE90, m", "mean east, m", "mean north, m",
        "located", "in the 95 % ellipse", "gimbal",
    )  # fmt: skip
    columns = [_method_column(method) for method in found.methods]
    return _table(head, list(zip(measures, *columns, strict=True)))


def _method_column(method: MethodResult) -> list[str]:
    errors = method.errors
    mean = errors.mean_error_en
    inside = sum(one.is_inside for one in method.located)
    count = len(method.located)
    return [
        _metres(errors.mean_point_rmse_m),
        _metres(errors.rmse_m),
        _metres(errors.ce90_m),
        *([_metres(None)] * 2 if mean is None else [f"{value:+.3f}" for value in mean.tolist()]),
        f"{count} of {count + len(method.refused)}",
        f"{inside} of {count}",
        method.composition,
    ]


def _tests_table(found: Evaluation) -> str:
    rows = [(one.first, one.second, _p_value(one.p_value, one.note)) for one in found.tests]
    table = _table(("method", "beside", "p-value"), rows)
    explanation = (
        "Two-sided p-values of the points' root mean square errors, pair by pair (Table 7)."
    )
    return f"{table}\n<p>{explanation}</p>"


def _p_value(value: float | None, note: str) -> str:
    if value is None:
        return note
    return f"{value:.4f}" if value >= 1e-4 else "< 0.0001"


def _points_table(found: Evaluation) -> str:
    columns = [(method.method, method.errors.point_rmse_m) for method in found.methods]
    rows = [
        [name, *[_metres(errors.get(name)) for _, errors in columns]] for name in found.control
    ]
    foot = ["mean", *[_metres(method.errors.mean_point_rmse_m) for method in found.methods]]
    table = _table(("point", *[name for name, _ in columns]), rows, foot)
    explanation = "Root mean square over a point's observations, m (Equation 24, Table 6)."
    return f"{table}\n<p>{explanation}</p>"


def _metres(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _table(
    head: Iterable[str], rows: Iterable[Sequence[str]], foot: Sequence[str] | None = None
) -> str:
    lines = ["<thead>", _row(head, "th"), "</thead>", "<tbody>"]
    lines += [_row(row, "td") for row in rows]
    lines.append("</tbody>")
    if foot is not None:
        lines += ["<tfoot>", _row(foot, "th"), "</tfoot>"]
    return '<div class="wide"><table>' + "".join(lines) + "</table></div>"


def _row(cells: Iterable[str], tag: str) -> str:
    """Return a row; names in a head may break at an underscore."""
    shown = [
        escape(cell).replace("_", "_<wbr>") if tag == "th" else escape(cell) for cell in cells
    ]
    return "<tr>" + "".join(f"<{tag}>{cell}</{tag}>" for cell in shown) + "</tr>"


def _figure(plot: Plot) -> str:
    pictures = [_embedded(svg, "image/svg+xml", plot.title) for svg in plot.svgs]
    caption = f"<figcaption>{escape(plot.caption)}</figcaption>"
    side = f'<div class="side">{"".join(pictures)}</div>'
    return f"<h2>{escape(plot.title)}</h2>\n<figure>{side}{caption}</figure>"


def _stills(stills: Sequence[Still]) -> list[str]:
    if not stills:
        return []
    figures = [
        f"<figure>{_embedded(still.jpeg, 'image/jpeg', still.caption)}"
        f"<figcaption>{escape(still.caption)}</figcaption></figure>"
        for still in stills
    ]
    return ["<h2>Overlay</h2>", '<div class="side">', *figures, "</div>"]


def _embedded(content: bytes, kind: str, words: str) -> str:
    data = base64.b64encode(content).decode()
    return f'<img alt="{escape(words, quote=True)}" src="data:{kind};base64,{data}">'


def _parameters(method: MethodResult) -> str:
    lines = [
        f"{node}: {name}: {value}"
        for node, values in method.parameters.items()
        for name, value in values.items()
    ]
    text = escape("\n".join(lines))
    return f"<details><summary>{escape(method.method)}</summary><pre>{text}</pre></details>"
