from pathlib import Path

from core.lab.benchmarks.charts import write
from core.lab.benchmarks.csv_files import Results
from core.lab.benchmarks.threads import ThreadTiming
from tests.conftest import image_size


def test_table_and_chart_compare_with_one_thread_beside_the_same_load(tmp_path: Path):
    seconds = {(0, 1): 4.0, (0, 2): 2.0, (1, 1): 6.0, (1, 2): 4.5}
    rows = tuple(ThreadTiming("fit", *key, value, value) for key, value in seconds.items())
    about = {"machine": "a machine", "category": "chairs"}
    lines = write(tmp_path, "threads", Results(about, rows)).strip().splitlines()[-4:]
    assert [line.split("|")[5].strip() for line in lines] == ["1.00", "0.50", "1.00", "0.75"]
    assert min(image_size(tmp_path / "threads.png")) > 100
