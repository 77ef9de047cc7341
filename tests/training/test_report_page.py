"""report.html: what is in it, that nothing breaks out of it or goes out from it, and that it works in a browser."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import guesser
import pytest
import yaml
from chromium import Chromium

from training.benchmark import Benchmark, run_benchmark
from training.cli import main
from training.comparison import grouped
from training.provenance import Provenance
from training.report_page import report_page
from training.report_page.markup import Markup, element

assert guesser

EVIL = "</script><script>document.title='broken'</script>\"'&$x$"
CONFIG = f"""
title: Guessers & <b>others</b>
note: {json.dumps(EVIL)}
seeds: {{first: 100005, count: 5}}
compare: guesser
scenarios:
  - {{scenario: rate-60x60x30, overrides: {{ending.success_radius: 50}}, label: near}}
  - {{scenario: rate-60x60x30, overrides: {{ending.success_radius: 20}}, label: {json.dumps(EVIL)}}}
policies:
  - guesser
  - {{policy: guesser, parameters: {{patience: 3}}, label: impatient}}
  - {{policy: guesser, parameters: {{patience: 40}}, label: "<img src=x onerror=alert(1)>", episodes: 2}}
"""
SWEPT = """
title: patience
seeds: {first: 100000, count: 3}
scenarios: [{scenario: rate-60x60x30, overrides: {ending.success_radius: 50}}]
policies: [guesser, {policy: guesser, label: wanderer, parameters: {spread: 30}}]
sweep: {of: policy, key: patience, values: [1, 3], label: patience}
"""
SMALL = """
title: two guessers
seeds: {first: 100000, count: 3}
scenarios: [{scenario: rate-60x60x30, overrides: {ending.success_radius: 50}}]
policies: [guesser, {policy: guesser, label: wanderer, parameters: {spread: 30}}]
compare: guesser
"""
RUN = Provenance("osl bench guessers --episodes 5", "2030-01-02", 61.0, 2, 24, 4)


class Reader(HTMLParser):
    """Rows of the tables by id, as texts; tags and addresses of everything."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tables: dict[str, list[list[str]]] = {}
        self.tags: list[str] = []
        self.addresses: list[str] = []
        self.handlers: list[str] = []
        self._rows: list[list[str]] | None = None
        self._in_cell = False
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.tags.append(tag)
        self.addresses += [str(given[key]) for key in ("src", "href", "xlink:href") if key in given]
        self.handlers += [key for key in given if key.startswith("on")]
        if tag == "table":
            self._rows = self.tables.setdefault(str(given["id"]), [])
        elif tag == "tr" and self._rows is not None:
            self._rows.append([])
        elif tag in ("th", "td") and self._rows:
            self._rows[-1].append("")
            self._in_cell = True

    def handle_endtag(self, tag: str) -> None:
        if tag in ("th", "td"):
            self._in_cell = False
        elif tag == "table":
            self._rows = None

    def handle_data(self, text: str) -> None:
        if self._rows and self._in_cell:
            self._rows[-1][-1] += text

    def column(self, table: str, number: int) -> list[str]:
        """The texts under the header of the column, from 1."""
        return [row[number - 1] for row in self.tables[table][1:]]


def made(text: str) -> str:
    benchmark = Benchmark.model_validate(yaml.safe_load(text))
    results = run_benchmark(benchmark, n_jobs=1)
    return report_page(benchmark, grouped(results, benchmark.compare), RUN)


@pytest.fixture(scope="module")
def page() -> str:
    return made(CONFIG)


@pytest.fixture(scope="module")
def address(page: str, tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("page") / "report.html"
    path.write_text(page, encoding="utf-8")
    return path.as_uri()


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Chromium:
    return Chromium(tmp_path_factory.mktemp("profiles"))


def test_markup_escapes_all_but_markup() -> None:
    made = element("p", "<i>", element("b", "&"), class_='x"y', aria_label="<", hidden=True, id=None)
    assert made == '<p class="x&quot;y" aria-label="&lt;" hidden>&lt;i&gt;<b>&amp;</b></p>'
    assert element("br") == Markup("<br>")


def test_page_has_the_tables_and_how_they_came_about(page: str) -> None:
    reader = Reader(page)
    assert list(reader.tables) == [
        "overall",
        *(f"{name}-{k}{part}" for k in (1, 2) for name, part in (("results", ""), ("paired", "-1"), ("cost", ""))),
        "scenarios",
        "policies",
    ]
    assert set(reader.column("results-1", 1)) == {"guesser", "impatient", "<img src=x onerror=alert(1)>"}
    assert reader.column("results-1", 2) == ["5", "5", "2"]
    assert reader.column("scenarios", 1) == ["near", EVIL]
    assert all(re.fullmatch("[0-9a-f]{12}", digest) for digest in reader.column("scenarios", 2))
    assert '"patience": 40' in reader.column("policies", 3)[2]
    for text in (RUN.command, "24, of which 20 were flown now and 4 before", "61 s with 2 processes", "Python 3."):
        assert text in page
    assert reader.tags.count("svg") == 3  # a chart a scenario, and the performance profile
    assert reader.tags.count("img") == 1


def test_nothing_breaks_out_and_nothing_goes_out(page: str) -> None:
    reader = Reader(page)
    assert reader.tags.count("script") == 1
    assert reader.handlers == []
    assert "b" not in reader.tags
    for place in reader.addresses:
        assert place.startswith(("#", "data:image/png;base64,")), place
    assert not re.search(r"@import|url\((?!#)", page)
    assert "default-src &#x27;none&#x27;" in page


def test_page_names_no_machine_and_no_folder(page: str) -> None:
    import getpass
    import platform

    text = re.sub(r"data:[^\"]*", "", page)
    assert str(Path.home()) + "/" not in text
    assert platform.node() not in text or platform.node() in "Linux x86_64 localhost"
    assert f"/{getpass.getuser()}/" not in text


def test_ids_are_unique(page: str) -> None:
    ids = re.findall(r'\bid="([^"]*)"', page)
    assert len(ids) == len(set(ids))


def test_a_sweep_has_a_page_with_its_values() -> None:
    reader = Reader(made(SWEPT))
    assert list(reader.tables) == ["results-1", "paired-1-1", "cost-1", "scenarios", "policies"]
    assert reader.tables["results-1"][0][:2] == ["policy", "patience"]
    assert reader.column("results-1", 2) == ["1", "1", "3", "3"]
    against = reader.column("results-1", 8)
    assert [(against[:2].count("best")), against[2:].count("best")] == [1, 1]  # each value has its own best
    assert reader.tags.count("svg") == 1


def test_bench_writes_the_page_and_says_where(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("guessers.yaml").write_text(SMALL, encoding="utf-8")
    assert main(["bench", "guessers.yaml", "--episodes", "2", "--jobs", "1"]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "open results/guessers/report.html"
    names = {"report.html", "figure.png", "table.csv", "table.json", "comparisons.csv", "episodes.csv"}
    assert {entry.name for entry in Path("results/guessers").iterdir()} == names
    text = Path("results/guessers/report.html").read_text(encoding="utf-8")
    assert "osl bench guessers.yaml --episodes 2" in text
    assert main(["bench", "guessers.yaml", "--episodes", "2", "--jobs", "1", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert {line["reference"] for line in content["comparisons"]} == {"guesser"}
    assert "of which 0 were flown now" in Path("results/guessers/report.html").read_text(encoding="utf-8")


def test_browser_opens_it_without_a_complaint(browser: Chromium, address: str) -> None:
    document, console = browser.page(address)
    assert console == ""
    assert "<title>Guessers &amp; &lt;b&gt;others&lt;/b&gt;</title>" in document
    assert "broken" not in re.findall(r"<title>(.*?)</title>", document)[0]
    reader = Reader(document)
    headers = sum(len(rows[0]) for rows in reader.tables.values())
    assert reader.tags.count("button") == headers + 1  # each header can be pressed, by key as well; and the theme


@pytest.mark.parametrize("way", ["", ",descending"])
def test_browser_sorts_numbers_and_keeps_what_is_missing_last(
    browser: Chromium, page: str, address: str, way: str
) -> None:
    document, console = browser.page(f"{address}#sort=results-1,5{way}")
    assert console == ""
    reader = Reader(document)
    times = [float(text.split()[0]) for text in reader.column("results-1", 5)]
    assert times == sorted(times, reverse=bool(way))
    assert f'aria-sort="{way[1:] or "ascending"}"' in document
    assert reader.tables["results-2"] == Reader(page).tables["results-2"]
    document, _ = browser.page(f"{address}#sort=results-1,7{way}")
    assert Reader(document).column("results-1", 7)[-1] == "reference"


def test_browser_sorts_names_and_ignores_what_is_no_table(browser: Chromium, address: str, tmp_path: Path) -> None:
    document, _ = browser.page(f"{address}#sort=policies,1")
    assert Reader(document).column("policies", 1) == ["<img src=x onerror=alert(1)>", "guesser", "impatient"]
    wrong = ("sort=nowhere,1", "sort=policies,99", "sort=policies", "sort=%3Cscript%3E,1", "theme=pink", "theme=", "=")
    frames = tmp_path / "frames.html"
    frames.write_text("".join(f'<iframe src="{address}#{text}"></iframe>' for text in wrong), encoding="utf-8")
    assert browser.page(frames.as_uri())[1] == ""


def test_browser_presses_a_header(browser: Chromium, page: str, tmp_path: Path) -> None:
    """With a script added that presses the first header twice, and says how wide the page is."""
    copy = tmp_path / "pressed.html"
    press = "const b=document.querySelectorAll('#overall thead button')[1]; b.click(); b.click();"
    measure = "const d=document.documentElement; d.dataset.overflow=d.scrollWidth-d.clientWidth"
    open_page = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", page)
    copy.write_text(open_page.replace("</body>", f"<script>{{{press}{measure}}}</script></body>"), encoding="utf-8")
    document, console = browser.page(copy.as_uri(), width=500)  # the narrowest window that Chromium opens
    assert console == ""
    assert Reader(document).column("overall", 2) == ["5", "5", "2"]
    assert 'data-overflow="0"' in document
    assert "sorted by episodes, descending" in document


def test_browser_paints_light_and_dark(browser: Chromium, address: str, tmp_path: Path) -> None:
    light = browser.screenshot(f"{address}#theme=light", tmp_path / "light.png")
    dark = browser.screenshot(f"{address}#theme=dark", tmp_path / "dark.png")
    assert _brightness(light) > 0.8
    assert _brightness(dark) < 0.3


def _brightness(png: bytes) -> float:
    """Mean of the picture, 0 black to 1 white."""
    import io

    from matplotlib.image import imread

    return float(imread(io.BytesIO(png), format="png")[..., :3].mean())
