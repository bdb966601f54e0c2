"""The live page: a session that runs a robot's loop in a thread of its own, and the web page that shows and steers it.

May import: every room of algorithms, drivers among them, and :mod:`dense_vs.view`.
"""

from typing import TYPE_CHECKING

from dense_vs.lazy_names import lazy_names

if TYPE_CHECKING:
    from dense_vs.live.gate import PageGate as PageGate
    from dense_vs.live.learning import Learning as Learning
    from dense_vs.live.learning import sureness as sureness
    from dense_vs.live.options import LiveOptions as LiveOptions
    from dense_vs.live.reachability import Reachability as Reachability
    from dense_vs.live.session import LiveSession as LiveSession
    from dense_vs.live.source import LiveSource as LiveSource

# Imported when first used: the command line's list of options needs none of it.
_HOMES = {
    "Learning": "learning",
    "LiveOptions": "options",
    "LiveSession": "session",
    "LiveSource": "source",
    "PageGate": "gate",
    "Reachability": "reachability",
    "sureness": "learning",
}

__all__ = list(_HOMES)  # pyright: ignore[reportUnsupportedDunderAll]  # they come by __getattr__
__getattr__, __dir__ = lazy_names(__name__, _HOMES)
