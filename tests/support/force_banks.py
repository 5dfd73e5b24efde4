"""Random banks of the general force law, as writes to the firmware's objects."""

import struct
import zlib

ONE = 1 << 26
# b0, b1, b2, a1, a2.
LOUD = (15 * ONE, 0, 0, 0, 0)  # runs into the ends of the signal
SECTIONS = [
    (93575093, -182443590, 91431145, -116878093, 52331006),  # a lead for 8 bits
    (388570733, -759775498, 381287265, -104435743, 47406946),  # and for 12
    (ONE // 2, ONE // 2, 0, 0, 0),
    LOUD,
    (ONE // 10, 0, 0, -ONE + ONE // 10, 0),
]


def random_bank(rng):
    """(name, value) of a bank of up to three sections, written and then selected; the firmware
    refuses the selection where the ADC does not bear it."""
    bank = rng.randint(1, 4)
    count = rng.choice([0, 1, 2, 3, 3, 3])
    among = [LOUD] if rng.random() < 0.25 else SECTIONS
    coefficients = [c for _ in range(count) for c in rng.choice(among)]
    coefficients += [0] * (15 - len(coefficients))
    gain, damping = rng.choice([20, 256, 1119, 65535]), rng.choice([0, 0, 300, 65535])
    values = [count, gain, damping, rng.choice([0, 357914, ONE]), *coefficients]
    names = [f"bank_{n}_{bank}" for n in ("sections", "gain", "velocity_gain", "integral")]
    names += [f"bank_coefficient_{15 * (bank - 1) + i + 1}" for i in range(15)]
    crc = zlib.crc32(struct.pack("<19I", *(v % (1 << 32) for v in values)))
    return [*zip(names, values, strict=True), (f"bank_crc_{bank}", crc), ("force_bank", bank)]
