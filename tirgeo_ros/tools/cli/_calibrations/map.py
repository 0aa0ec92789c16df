"""The verb ``tirgeo calibrate map``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from tirgeo_ros.tools.cli._verb import Subparsers, UsageError


def add_parser(subparsers: Subparsers) -> argparse.ArgumentParser:
    """Declare the verb's arguments."""
    parser = subparsers.add_parser(
        "map",
        help="a map from features digitised on an orthophoto, by control points",
        description="Takes features digitised in pixels of an orthophoto to the ground by a "
        "polynomial through control points, and writes them as GeoJSON in WGS84. Pixels are "
        "counted from the top left corner; QGIS's rows below zero are turned. Residuals are told "
        "for each point, and what lies outside the points' hull is warned of.",
        epilog="example:\n  tirgeo calibrate map beds_px.geojson --points marks.csv "
        "--survey survey.geojson -o map.geojson --plot residuals.png\n"
        "  tirgeo calibrate map beds_px.geojson --points ortho.points -o map.geojson --order 2",
    )
    parser.add_argument(
        "vectors", type=Path, metavar="PIXELS.geojson", help="coordinates are column, row"
    )
    parser.add_argument(
        "--points",
        type=Path,
        metavar="FILE",
        required=True,
        help="id,column,row with --survey, or a .points file of QGIS's georeferencer",
    )
    parser.add_argument(
        "--survey", type=Path, metavar="GCPS", help="GeoJSON points, or CSV id,lat,lon,h"
    )
    parser.add_argument("-o", "--output", type=Path, metavar="GEOJSON", required=True)
    parser.add_argument(
        "--order", type=int, choices=(1, 2, 3), default=3, help="of the polynomial (default: 3)"
    )
    parser.add_argument(
        "--crs", metavar="CRS", help="plane of the fit (default: the UTM zone of the points)"
    )
    parser.add_argument(
        "--points-crs", metavar="CRS", help="of a .points file that does not name it"
    )
    parser.add_argument("--residuals", type=Path, metavar="CSV", help="a line for each point")
    parser.add_argument("--plot", type=Path, metavar="PNG", help="residuals as arrows")
    parser.add_argument(
        "--image", type=Path, metavar="ORTHO", help="lay this picture too (needs rasterio)"
    )
    parser.add_argument(
        "--geotiff", type=Path, metavar="TIF", help="where to (default: beside the GeoJSON)"
    )
    return parser


def run(args: argparse.Namespace) -> dict[str, object]:
    """Georeference the features; return a summary."""
    from tirgeo_ros.tools.calibrate.map import calibrate_map  # noqa: PLC0415 heavy

    if args.survey is not None and args.points_crs is not None:
        raise UsageError("--points-crs is for a .points file, which goes without --survey")
    if args.geotiff is not None and args.image is None:
        raise UsageError("--geotiff needs the picture: --image")
    geotiff = args.geotiff or args.output.with_suffix(".tif")
    return calibrate_map(
        args.vectors,
        args.points,
        args.output,
        survey=args.survey,
        points_crs=args.points_crs,
        order=args.order,
        crs=args.crs,
        residuals_csv=args.residuals,
        plot=args.plot,
        image=args.image,
        geotiff=geotiff if args.image is not None else None,
    )


def describe(result: dict[str, Any]) -> str:
    """Return the residuals as a table, their means, and what was written."""
    rows = [("point", "column", "row", "x [m]", "y [m]", "length [m]", "[px]", "left out [m]")]
    rows += [
        (
            one["id"],
            f"{one['column']:.1f}",
            f"{one['row']:.1f}",
            f"{one['x_m']:.4f}",
            f"{one['y_m']:.4f}",
            f"{one['length_m']:.4f}",
            f"{one['length_px']:.2f}",
            f"{one['left_out_m']:.4f}",
        )
        for one in result["residuals"]
    ]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = ["  ".join(c.rjust(w) for c, w in zip(row, widths, strict=True)) for row in rows]
    means = (
        f"mean residual {result['mean_residual_px']:.2f} px, {result['mean_residual_m']:.4f} m "
        f"(rms {result['rms_residual_px']:.2f} px, {result['rms_residual_m']:.4f} m; each point "
        f"left out {result['rms_left_out_m']:.4f} m)"
    )
    fit = f"order {result['order']} in {result['crs']}, {result['pixel_m']:.4g} m a pixel"
    laid = f"{result['features']} features, {result['features_outside']} of them reach outside"
    return "\n".join([*lines, means, fit, laid, f"written: {', '.join(result['output'])}"])
