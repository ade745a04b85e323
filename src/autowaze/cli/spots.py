"""`autowaze spots`: parking maps from other sources, and what is wrong with them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from autowaze.cli.options import JsonFile, console
from autowaze.world.drawn_spots import DrawnSpots, document_of, load_document, read_drawn_spots
from autowaze.world.errors import AutowazeError, MapFileError
from autowaze.world.georeference import Georeference
from autowaze.world.spot_check import Finding, check_spots, mended
from autowaze.world.streets import StreetNetwork

app = typer.Typer(no_args_is_help=True, help="Parking maps: import them, check them.")
_SHOWN = 40

Streets = Annotated[Path | None, typer.Option(help="Streets and buildings, GeoJSON.")]


@app.command("import")
def import_spots(
    sources: Annotated[list[Path], typer.Argument(help="GeoJSON, .osm, .osm.bz2, .osm.pbf, or CDS curbs as JSON.")],
    output: Annotated[Path, typer.Option("-o", "--output", help="The parking map, GeoJSON.")],
    streets: Annotated[Path | None, typer.Option(help="Also write streets and buildings (OpenStreetMap).")] = None,
    bbox: Annotated[str, typer.Option(help="Only what lies in west,south,east,north, degrees.")] = "",
    georeference: Annotated[str, typer.Option(help="Origin of the map as lat,lon; the middle unless given.")] = "",
) -> None:
    """Make a parking map of what others have surveyed.

    Examples:

        autowaze spots import berlin.osm.pbf -o parking_map.geojson --streets streets.geojson --bbox 13.4,52.4,13.5,52.5

        autowaze spots import zones.json spaces.json -o parking_map.geojson
    """
    from autowaze.world.surveys.survey import survey

    origin = _numbers(georeference, 2, "--georeference: expected lat,lon in degrees")
    box = _numbers(bbox, 4, "--bbox: expected west,south,east,north in degrees")
    found = survey(
        sources,
        Georeference(origin[0], origin[1]) if origin else None,
        (box[0], box[1], box[2], box[3]) if box else None,
    )
    _write(output, found.drawn)
    for reason, count in found.left_out.most_common():
        console.print(f"left out: {count} {reason}", markup=False)
    if streets is not None:
        if found.streets is None:
            raise AutowazeError(f"{streets}: not written: this source holds no streets, only OpenStreetMap does")
        try:
            found.streets.to_geojson(streets)
        except OSError as error:
            raise MapFileError(f"{streets}: cannot be written: {error.strerror}") from error
        console.print(f"{streets}: {len(found.streets.streets)} streets, {len(found.streets.buildings)} buildings")
    kinds = {kind: found.drawn.kinds.count(kind) for kind in sorted(set(found.drawn.kinds))}
    console.print(f"{output}: {len(found.drawn)} spots (" + ", ".join(f"{n} {kind}" for kind, n in kinds.items()) + ")")
    faults = len(check_spots(found.drawn))
    if faults:
        console.print(f"{faults} faults: see autowaze spots check {output}", markup=False)


@app.command("check")
def check(
    file: Annotated[Path, typer.Argument(help="A parking map, GeoJSON.")],
    streets: Streets = None,
    fix: Annotated[bool, typer.Option("--fix", help="Mend what has one cure only, in the file.")] = False,
    json_file: JsonFile = None,
) -> None:
    """Say what is wrong with a parking map, a line each; exit code 2 if anything is.

    Example:

        autowaze spots check parking_map.geojson --streets streets.geojson --fix
    """
    drawn = read_drawn_spots(load_document(file), str(file))
    if fix:
        drawn, done = mended(drawn)
        if done:
            _write(file, drawn)
        for finding in done:
            console.print(f"mended: {finding}", markup=False)
    lines = StreetNetwork.from_geojson(streets, drawn.georeference).streets.line if streets is not None else None
    findings = check_spots(drawn, lines)
    for finding in findings[:_SHOWN]:
        console.print(str(finding), markup=False)
    if len(findings) > _SHOWN:
        console.print(f"… and {len(findings) - _SHOWN} more; --json FILE has all of them", markup=False)
    if json_file is not None:
        _write_findings(json_file, file, drawn, findings)
    if findings:
        raise typer.Exit(2)
    console.print(f"{file}: {len(drawn)} spots, nothing wrong", markup=False)


def _write(path: Path, drawn: DrawnSpots) -> None:
    partial = path.with_name(path.name + ".partial")
    try:
        partial.write_text(json.dumps(document_of(drawn), separators=(",", ":"), allow_nan=False), encoding="utf-8")
        partial.replace(path)
    except OSError as error:
        raise MapFileError(f"{path}: cannot be written: {error.strerror}") from error


def _write_findings(path: Path, file: Path, drawn: DrawnSpots, findings: list[Finding]) -> None:
    rows = [
        {"spot_id": f.spot_id, "feature": f.row, "fault": f.fault.value, "detail": f.detail, "lon": f.lon, "lat": f.lat}
        for f in findings
    ]
    document = {"file": str(file), "spots": len(drawn), "findings": rows}
    try:
        path.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        raise MapFileError(f"{path}: cannot be written: {error.strerror}") from error


def _numbers(text: str, count: int, complaint: str) -> list[float] | None:
    if not text:
        return None
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError as error:
        raise AutowazeError(complaint) from error
    if len(numbers) != count or not all(abs(number) <= 180.0 for number in numbers):
        raise AutowazeError(complaint)
    return numbers
