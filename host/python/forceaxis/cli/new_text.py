"""Text that `forceaxis new` prints on a terminal."""

import shlex

from forceaxis.design.grid import LOWEST_HZ
from forceaxis.design.new import GAIN_MOST, HELD, BankForAxis, NewAxis, NoBank

LIMIT_NAMED_BELOW = (
    # Below this ratio of the bandwidths with filter bank and with P law, the text states the limit.
    1.5
)


def describe(done: NewAxis) -> list[tuple[str, str]]:
    """Return the text lines (key, text) about the written files, the gain of the P law and the
    designed filter bank."""
    return [
        ("written", ", ".join(shlex.quote(f"{done.folder}/{name}") for name in done.files)),
        ("total mass", f"{done.total_mass_kg:.4g} kg{done.mass_with}"),
        ("force gain", f"{done.force_gain:.4g}{_reserve(done)}"),
        ("set-point", f"{done.setpoint_N:.4g} N, of which this gain holds "
         f"{100 * done.held_share:.3g} %{done.held_with}"),
        *_bank(done.design),
        *(("check", text) for text in done.doubts),
        ("not given", f'{done.marked} values: look for "default, check" in model.toml'),
        ("next", f"forceaxis run {shlex.quote(done.folder + '/contact.toml')}"),
    ]  # fmt: skip


def _reserve(done: NewAxis) -> str:
    """Return a text that follows the gain of the P law. It states the factor by which this gain can
    be raised before the contact becomes unstable, and the critical gain of the linear loop."""
    limit = f"{done.force_limit_gain:.4g}"
    if done.force_limit_gain >= GAIN_MOST:
        limit = f"{GAIN_MOST:g} at least, the largest gain that the firmware stores"
    if done.force_gain_reserve is None:
        return f", a sixth of the linear limit {limit}"
    return (
        f"; the contact is stable up to {done.force_gain_reserve:g} times it, the linear loop to "
        f"{limit}"
    )


def _bank(bought: BankForAxis | NoBank | None) -> list[tuple[str, str]]:
    """Return the text lines (key, text) that compare the designed filter bank with a P law that has
    the same margins."""
    if bought is None:
        return []
    if isinstance(bought, NoBank):
        return [("bank", f"none: {bought.refused}")]
    before, after = bought.p_fS_Hz, bought.fS_Hz
    rows = [("set", f"{bought.set_text}: what P and bank bear below, at the same margins")]
    times = ""
    if before is not None and bought.p_static_error is not None:
        reached = "|S| never below -3 dB"
        # this text applies if |S| with the P law is below -3 dB at low frequencies
        if before > 1.01 * LOWEST_HZ:
            reached, times = f"bandwidth fS {before:.3g} Hz", f", {after / before:.2g} times P's"
        rows.append(
            ("P", f"force_gain {bought.p_force_gain:.4g}, {reached}, static error up to "
             f"{100 * bought.p_static_error:.3g} %")
        )  # fmt: skip
    rows.append(
        ("bank", f"{bought.structure}, bandwidth fS {after:.3g} Hz{times}, no static error: {HELD}")
    )
    if times and before is not None and after < LIMIT_NAMED_BELOW * before:
        rows.append(("limited by", bought.limited_by))
    return rows
