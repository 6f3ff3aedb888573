import pandas as pd
import pytest

from core.lab.benchmarks.held_out_views import BENCHMARK
from core.lab.benchmarks.page import BLOCKS, PAGE, fill, read_frames, write_page

CHARTS_FOLDER = BENCHMARK.parent / "charts"
MOST_LINES, MOST_WORDS, MOST_COLUMNS = 120, 12, 5  # of the page, of a cell, of a table


def test_the_page_shows_the_numbers_of_the_rows() -> None:
    page = (CHARTS_FOLDER / PAGE).read_text(encoding="utf-8")
    assert fill(page, read_frames(CHARTS_FOLDER)) == page
    assert all(f"<!-- {name} -->" in page for name in BLOCKS)
    assert len(page.splitlines()) <= MOST_LINES
    for line in page.splitlines():
        if line.startswith("|"):
            cells = line.strip("|").split("|")
            assert len(cells) <= MOST_COLUMNS, line
            assert max(len(cell.split()) for cell in cells) <= MOST_WORDS, line


def test_a_part_that_is_missing_leaves_its_blocks_empty() -> None:
    page = "<!-- speed_table -->\nold\n<!-- end -->\n**Frames.** <!-- frames -->old<!-- end -->"
    assert fill(page, {}) == page.replace("old", "Not measured yet.")
    with pytest.raises(ValueError, match="no block 'unknown'"):
        fill("<!-- unknown -->\n<!-- end -->", {})
    with pytest.raises(ValueError, match="no CSV file of a benchmark"):
        write_page(BENCHMARK)


def test_the_worth_of_a_part_is_paired() -> None:
    """A hard object that one method alone was tried on does not count."""
    rows = [("a", "normal", 20.0), ("b", "normal", 30.0), ("a", "without restart", 21.0)]
    frame = pd.DataFrame(rows, columns=["name", "case", "novel.psnr"])
    frame = frame.assign(category="chairs", number=0, right=1.0, seconds=1.0)
    table = fill("<!-- parts_table -->\n<!-- end -->", {"fits": frame})
    assert "| without restart | 1 | +1.00 (+1.00 to +1.00) | +0 | 1.00 |" in table
