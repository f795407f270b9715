"""The tables that `dense.py` prints."""

from collections.abc import Mapping, Sequence

from benchmarks.dense_peers import PEERS, WAYS
from benchmarks.results import table

Figures = Mapping[str, Mapping[str, float]]  # by row and name
LEAST_COMPLETE = 97.0  # %
HALF = 0.5  # of the peer's error


def report(figures: Figures, threads: int, full: bool) -> None:
    """Print ours, ours beside the peer in error, time and memory, our own calibration, and the peer by pairs."""
    columns = ["complete %", "bad-1 %", "bad-2 %", "bad-5 %", "median %", "rms %", "rms px", "error/sigma"]
    keys = [f"{key}_percent" for key in ("complete", "bad1", "bad2", "bad5", "median", "rms98")]
    _table("cyclopean", columns, [*keys, "rms98_px", "error_over_sigma_times"], figures)
    scales = (1, 2) if full else (1,)
    for scale in scales:
        _beside(f"sgbm{scale}x", figures)
    _seconds(figures, threads)
    _work(figures)
    if full:
        columns = ["complete %", "bad-1 %", "median %", "rms %", "/ true: bad-1", "median", "rms"]
        keys = [f"calibrated_{key}_percent" for key in ("complete", "bad1", "median", "rms98")]
        keys += [f"calibrated_{key}_over_true_times" for key in ("bad1", "median", "rms98")]
        own = {name: row for name, row in figures.items() if keys[0] in row}
        _table("cyclopean with its own calibration", columns, keys, own)
    for scale in scales:
        columns = ["complete %", *(head for way in WAYS for head in (f"{way}: bad-1 %", "median %", "rms px"))]
        keys = [f"sgbm{scale}x_exact_pairs_complete_percent"]
        keys += [
            f"sgbm{scale}x_{way}_pairs_{key}" for way in WAYS for key in ("bad1_percent", "median_percent", "rms98_px")
        ]
        _table(f"OpenCV at {scale}x, pairs", columns, keys, figures)


def half_as_wrong(row: Mapping[str, float], peer: str = "sgbm2x") -> bool:
    """Whether ours has at most half of the peer's bad-1 % and median error, and is complete."""
    errors = row[f"bad1_over_{peer}_times"], row[f"median_over_{peer}_times"]
    return max(errors) <= HALF and row["complete_percent"] >= LEAST_COMPLETE


def _beside(peer: str, figures: Figures) -> None:
    """Errors of a peer's merged depths by exact rays, and ours over them."""
    heads = ["", "complete %", "bad-1 %", "median %", "rms px", "| bad-1 x", "median x", "px x", "half"]
    keys = [f"{key}_percent" for key in ("complete", "bad1", "median")]
    rows = []
    for name, row in figures.items():
        cells = [row[f"{peer}_exact_{key}"] for key in (*keys, "rms98_px")]
        cells += [row.get(f"{what}_over_{peer}_times") for what in ("bad1", "median", "rms98")]
        rows.append([name, *cells, "yes" if half_as_wrong(row, peer) else "no"])
    table(f"{PEERS[peer].title}, merged, exact rays | cyclopean over it", heads, rows)


def _seconds(figures: Figures, threads: int) -> None:
    """Seconds of ours and of all peers."""
    peers = [peer for peer in PEERS if all(f"{peer}_seconds" in row for row in figures.values())]
    columns, keys = ["match", "first", "further"], ["match_seconds", "first_seconds", "further_seconds"]
    ways = {"_seconds": "with remapping", "_pairs_at_once_seconds": f"with remapping, {threads} pairs at once"}
    _table(
        f"seconds, {threads} threads: cyclopean | OpenCV, all ordered pairs, matching alone",
        [*columns, *(f"| {peer}" for peer in peers)], [*keys, *(f"{peer}_match_seconds" for peer in peers)], figures,
    )  # fmt: skip
    for end, title in ways.items():
        _table(f"seconds: OpenCV, {title}", peers, [f"{peer}{end}" for peer in peers], figures)
    for end, title in (("_match", "matching alone"), ("", "with remapping")):
        keys = [f"{peer}{end}_over_ours_times" for peer in peers]
        _table(f"OpenCV's seconds, {title}, over cyclopean's match", peers, keys, figures)


def _work(figures: Figures) -> None:
    """Hypotheses a second, and memory."""
    columns = ["number", "effective M/s", "tried M/s", "match MiB", "whole"]
    keys = ["hypotheses", "effective_million_per_s", "tried_million_per_s", "match_mib", "whole_mib"]
    for peer in ("sgbm1x", "sgbm2x"):
        columns, keys = [*columns, peer], [*keys, f"{peer}_match_mib"]
    _table("hypotheses: million pixels x hypotheses x other views a second (M/s); memory, MiB", columns, keys, figures)


def _table(title: str, columns: Sequence[str], keys: Sequence[str], figures: Figures) -> None:
    table(title, ["", *columns], [[name, *(row.get(key) for key in keys)] for name, row in figures.items()])
