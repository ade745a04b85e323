"""The evaluation's report as a browser shows it: by itself, at any size, for everyone."""

from pathlib import Path

import pytest

from autowaze.evaluation.experiments.figures import draw_calibration
from autowaze.evaluation.experiments.judging import Verdict
from autowaze.evaluation.experiments.scores import calibrate
from autowaze.evaluation.reporting.document import Commands, Document, Picture, Section, Table, Text
from autowaze.evaluation.reporting.html_page import html_of
from autowaze.evaluation.reporting.markdown_page import markdown_of
from autowaze.world.parking import Occupancy

AXE = Path(__file__).parents[2] / "live-map" / "node_modules" / "axe-core" / "axe.min.js"


@pytest.fixture(scope="module")
def document():
    verdicts = [
        Verdict("one", "A", n > 7, True, True, Occupancy.VACANT, 0.8, "", False, float("nan"), float("nan"))
        for n in range(10)
    ]
    headings = ("method", *(f"a long heading number {n}" for n in range(12)))
    table = Table(
        headings, (("`fused`", *("0.987 (0.950 to 1.000)",) * 12), ("<b>thesis</b>", *("",) * 12)), frozenset([0])
    )
    picture = Picture("calibration", draw_calibration({"town, fused": calibrate(verdicts)}), "Stated & true")
    blocks = [
        Text("What `autowaze evaluate all` found."),
        table,
        picture,
        Commands(("autowaze evaluate all -o " + 90 * "x",)),
    ]
    return Document(
        "Autowaze: evaluation", [Section("Town streets", blocks), Section("How this was made", [Text("So.")])]
    )


@pytest.fixture
def opened(browser, document, tmp_path):
    path = tmp_path / "report.html"
    path.write_text(html_of(document), encoding="utf-8")
    contexts, complaints = [], []

    def open_at(width, scheme):
        context = browser.new_context(viewport={"width": width, "height": 700}, color_scheme=scheme, offline=True)
        contexts.append(context)
        page = context.new_page()
        page.on("console", lambda m: complaints.append(m.text) if m.type in ("error", "warning") else None)
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on(
            "request", lambda r: complaints.append(r.url[:80]) if not r.url.startswith(("file:", "data:")) else None
        )
        page.goto(path.as_uri())
        return page

    yield open_at
    for context in contexts:
        context.close()
    assert complaints == []


@pytest.mark.parametrize(("width", "scheme"), [(1200, "light"), (360, "dark")])
def test_the_page_stands_for_itself(opened, width, scheme):
    page = opened(width, scheme)
    assert page.title() == "Autowaze: evaluation"
    assert page.evaluate("[...document.images].every(i => i.complete && i.naturalWidth > 100)")
    assert page.evaluate("document.documentElement.scrollWidth") <= width  # wide tables scroll by themselves
    assert page.locator("tr.strong th").inner_text() == "fused"
    assert page.locator("th", has_text="<b>thesis</b>").count() == 1
    page.click("nav >> text=How this was made")
    assert page.evaluate("location.hash") == "#how-this-was-made"
    page.evaluate(AXE.read_text(encoding="utf-8"))
    found = page.evaluate("() => axe.run(document, {resultTypes: ['violations']})")["violations"]
    assert [(v["id"], [node["html"][:160] for node in v["nodes"]]) for v in found] == []


def test_the_same_as_markdown(document):
    text = markdown_of(document)
    assert "![Stated & true](images/calibration.png)" in text
    assert "| **`fused`** | **0.987 (0.950 to 1.000)** |" in text
    assert text.splitlines()[0] == "# Autowaze: evaluation"
