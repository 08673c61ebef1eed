"""File names that no system can have."""

RESERVED = {"CON", "PRN", "AUX", "NUL", *(f"{port}{n}" for port in ("COM", "LPT") for n in "123456789¹²³")}


def is_reserved(name: str) -> bool:
    """Whether Windows takes a file name for a device, whatever its suffixes."""
    return name.split(".")[0].strip().upper() in RESERVED
