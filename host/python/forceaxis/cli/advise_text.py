"""Text of `forceaxis compliance` for a terminal."""

import textwrap

from forceaxis.design.compliance import Compliance


def describe_compliance(result: Compliance) -> str:
    """The figures at each stiffness for a terminal."""

    def number(value: float | None, scale: float = 1.0) -> str:
        return "-" if value is None else f"{scale * value:.3g}"

    def strike(value: float | None) -> str:
        return (">= " if value == result.strike_max_N_s else "") + number(value)

    lines = [
        f"model        {result.model}, {result.element} = {result.present:.6g} N/m",
        f"set          {', '.join(result.over) or 'this plant alone'}",
        *([f"mode         {result.mode_text}"] if result.mode_text else []),
        f"set-point    {result.setpoint_N:.4g} N",
    ]
    table = [["", "P fS", "bank fS", "P error", "motion", "P strike", "bank strike"],
             ["N/m", "Hz", "Hz", "%", "mm", "N s", "N s"]]  # fmt: skip
    for row in result.rows:
        table.append([
            f"{row.stiffness:.4g}", number(row.p_fS_Hz), number(row.fS_Hz),
            number(row.p_static_error, 100), number(row.motion_m, 1e3),
            strike(row.p_strike_N_s), strike(row.strike_N_s),
        ])  # fmt: skip
    wide = [max(len(r[i]) for r in table) for i in range(len(table[0]))]
    lines += ["  ".join(c.rjust(w) for c, w in zip(r, wide, strict=True)) for r in table]
    lines += textwrap.wrap(
        "fS: lowest frequency at which |S| reaches -3 dB, of the set's worst member; error: of the "
        "force held; motion: of the drive, from touch to the set-point; strike: the hardest "
        "survived in simulation; -: no gain at the margins",
        80,
    )
    return "\n".join(lines)
