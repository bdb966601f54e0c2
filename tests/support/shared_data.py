"""Where recordings of others lie, beside a checkout; tests that read them skip without it."""

from pathlib import Path

SHARED_DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
