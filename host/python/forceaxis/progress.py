"""How far a long computation is. A verb shows it on a terminal; elsewhere nothing reads it."""

shown = ""  # such as "34/98 experiments"


def counted(items, what, total=None):
    """The items one by one, while `shown` says how many of them are done. what: their plural."""
    global shown
    total, before = len(items) if total is None else total, shown
    try:
        for done, item in enumerate(items):
            shown = ", ".join(filter(None, (before, f"{done}/{total} {what}")))
            yield item
    finally:
        shown = before
