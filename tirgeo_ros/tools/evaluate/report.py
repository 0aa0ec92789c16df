"""Write an evaluation as one self-contained page: tables, figures and stills."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path

from tirgeo_ros import __version__
from tirgeo_ros.tools.evaluate.flight_plots import flight_plots
from tirgeo_ros.tools.evaluate.ground_plots import Plot, ground_plots
from tirgeo_ros.tools.evaluate.result import Evaluation, MethodResult, Still
from tirgeo_ros.tools.evaluate.summary import summary
from tirgeo_ros.tools.evaluate.tables import Table, tables
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
thead th { border-bottom: 2px solid #999; }
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
        *[_table(one) for one in tables(summary(found))],
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
    ground = found.methods[0].setup.ground_words if found.methods else ""
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


def _table(one: Table) -> str:
    rows = "".join(_row(row, "td") for row in one.rows)
    body = f"<thead>{_row(one.head, 'th')}</thead><tbody>{rows}</tbody>"
    return "\n".join(
        [
            f"<h2>{escape(one.title[:1].upper() + one.title[1:])}</h2>",
            f'<div class="wide"><table>{body}</table></div>',
            *(f"<p>{escape(note)}</p>" for note in one.notes),
        ]
    )


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
        for node, values in method.setup.parameters.items()
        for name, value in values.items()
    ]
    text = escape("\n".join(lines))
    return f"<details><summary>{escape(method.method)}</summary><pre>{text}</pre></details>"
