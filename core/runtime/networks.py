"""Third-party networks: ONNX files, run by onnxruntime on one thread."""

import os
from pathlib import Path

import numpy as np
from jaxtyping import Float

from core.runtime.reading import first_line, shortened

NETWORKS = Path(__file__).resolve().parents[2] / "assets" / "networks"


def run_network(path: Path, batch: Float[np.ndarray, "1 *shape"]) -> dict[str, np.ndarray]:
    """Return a network's outputs by name, for a batch of one.

    Raises ``ValueError`` naming the file if it is missing or damaged. The network is unloaded afterwards: loading takes
    0.1 s, and keeping all networks would take 50 MB.
    """
    if not path.is_file():
        raise ValueError(f"{path.name} is missing from {path.parent}")
    try:
        os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")  # which would write and send on import
        import onnxruntime  # takes 0.1 s, and many images need no network

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1  # more would busy-wait beside other programs
        options.enable_cpu_mem_arena = options.enable_mem_pattern = False  # would keep half a gigabyte for the next run
        options.log_severity_level = 4
        session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
        names = [output.name for output in session.get_outputs()]
        return dict(zip(names, session.run(names, {session.get_inputs()[0].name: batch}), strict=True))
    except Exception as error:
        raise ValueError(f"{path.name} cannot be used: {shortened(first_line(error), 100)}") from error
