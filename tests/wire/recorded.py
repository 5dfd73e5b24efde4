"""What candump recorded of a node, beside what the node sent.

A recorder on a busy machine may lose frames. `candump -d` reports how many, and where: a line
"DROPCOUNT: dropped N CAN frames ..." before the next frame it has.
"""

QUEUED = 16  # frames after the end: the node's transmit queue


def entries(text):
    """Of a log of `candump -L -d`: (time, identifier, data) of each frame, data None of a remote
    one, and between them the numbers of frames lost there."""
    found = []
    for line in text.splitlines():
        words = line.split()
        if words[0] == "DROPCOUNT:":
            found.append(int(words[2]))
            continue
        when, _, frame = words
        identifier, data = frame.split("#")
        remote = data.startswith("R")
        found.append(
            (float(when[1:-1]), int(identifier, 16), None if remote else bytes.fromhex(data))
        )
    return found


def difference(log, sent, unplaced=0):
    """None where `log` is a record of `sent`, else one line that says what is wrong.

    `log` has the frames and the numbers of lost frames between them, `sent` the frames in order.
    Frames may be missing where that many were reported lost, and `unplaced` more between any two,
    lost before candump could count them. More than half must be there. At most QUEUED may follow
    the end.
    """
    frames = [entry for entry in log if not isinstance(entry, int)]
    if 2 * len(frames) <= len(sent) and sent:
        return f"{len(frames)} frames recorded of {len(sent)}"
    # How many of `sent` may have passed: equal frames leave several answers.
    passed, matched, lost = {0}, 0, unplaced
    for entry in log:
        if isinstance(entry, int):
            lost += entry
            continue
        before = {p for start in passed for p in range(start, min(start + lost + 1, len(sent)))}
        after = {p + 1 for p in before if sent[p] == entry}
        if not after:
            break
        passed, matched, lost = after, matched + 1, unplaced
    if max(passed) + lost < len(sent):
        recorded = frames[matched] if matched < len(frames) else "the end"
        return (
            f"recorded frame {matched} is {recorded}, expected {sent[max(passed)]} or one of the "
            f"{lost} after it"
        )
    if len(frames) - matched > QUEUED:
        return f"{len(frames) - matched} frames after the end"
    return None
