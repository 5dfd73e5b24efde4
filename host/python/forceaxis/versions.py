"""The versions of the program, the firmware, the object table, the LCM message types and the file
formats."""

import hashlib
from importlib.metadata import version

from forceaxis import _core, objects


def rows() -> list[tuple[str, str]]:
    """Returns pairs (name, version) of the program, the firmware, the object table, the LCM types
    and the file formats."""
    from forceaxis.bus import messages

    types = (getattr(messages, name) for name in sorted(vars(messages)) if name.endswith("_t"))
    fingerprints = b"".join(
        t._get_packed_fingerprint() for t in types if hasattr(t, "_get_packed_fingerprint")
    )
    return [
        ("forceaxis", version("forceaxis")),
        ("firmware", _core.FIRMWARE_VERSION),
        ("object table", objects.OBJECTS_HASH[:8]),
        ("LCM types", hashlib.sha256(fingerprints).hexdigest()[:8]),
        ("models and experiments", str(_core.FILE_FORMAT)),
        ("parameter set", _core.PARAMETER_SET_FORMAT),
        ("axis journal", _core.JOURNAL_FORMAT.split()[1]),
    ]
