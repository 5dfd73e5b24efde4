"""Numbers as people read them."""


def plain(value, digits=3):
    """A number of so many digits, thousands apart from five places on (28,890); an exponent only
    for what is very large or small."""
    rounded = float(f"{value:.{digits}g}")
    if not 1e3 <= abs(rounded) < 1e7:
        return f"{value:.{digits}g}"
    decimals = max(0, digits - len(str(int(abs(rounded)))))
    text = f"{rounded:,.{decimals}f}"
    return text if abs(rounded) >= 1e4 else text.replace(",", "")
