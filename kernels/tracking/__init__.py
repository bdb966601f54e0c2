"""Points that are carried by flow and aligned with their patch."""
