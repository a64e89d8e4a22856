"""Results that tiny-cuda-nn gave on a GPU, with its parameters: `data/tcnn_vectors.npz`, of 57 configurations.

Recorded from its commit 6ee3546 without run-time fusion, 256 rows each. `dx` and `dparams` hold its loss scale.
"""

import json
import zlib
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

ARRAYS = np.load(Path(__file__).parent / "data" / "tcnn_vectors.npz")
RECORDS = json.loads(str(ARRAYS["index_json"]))


@dataclass(frozen=True)
class Vectors:
    record: dict
    params: np.ndarray  # [n_params], fp32 or fp16
    x: np.ndarray  # [256, n_in]
    dy: np.ndarray  # [256, n_out], without loss scale
    y: np.ndarray  # [256, n_out]
    dx: np.ndarray  # [256, n_in], without loss scale; NaN in columns that no part reads
    dparams: np.ndarray | None  # [n_params], without loss scale


@cache
def vectors(name: str) -> Vectors:
    record, n_out = RECORDS[name], RECORDS[name]["n_out"]
    scale = record["loss_scale"]
    x, dy = (ARRAYS[f"inputs/{record[key]}"] for key in ("input", "dy"))
    dparams = ARRAYS[f"{name}/dparams"].astype(np.float32) / scale if record["n_params"] else None
    y, dx = ARRAYS[f"{name}/y"].astype(np.float32), ARRAYS[f"{name}/dx"] / np.float32(scale)
    return Vectors(record, params(record), x, dy[:, :n_out].astype(np.float32) / scale, y[:, :n_out], dx, dparams)


def params(record: dict) -> np.ndarray:
    """Numbers in [-s, s) from a hash of the index, s one for the network and one for grids, in that order."""
    u = (np.arange(record["n_params"], dtype=np.uint32) + np.uint32(1)) * np.uint32(2654435761)
    u ^= u >> np.uint32(15)
    u *= np.uint32(2246822519)
    u ^= u >> np.uint32(13)
    v = (u >> np.uint32(8)).astype(np.float32) * np.float32(2.0**-23) - np.float32(1)
    n = record["n_network_params"]
    v[:n] *= np.float32(record.get("s_net", 0))
    v[n:] *= np.float32(record.get("s_grid", 0))
    v = v.astype(np.float16) if record["param_precision"] == "fp16" else v
    assert zlib.crc32(v.tobytes()) == record["params_crc32"]
    return v
