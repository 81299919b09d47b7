"""Names of units: MTConnect's lists, and what users write for them."""

MTCONNECT_UNITS = (
    "MILLIMETER", "MILLIMETER/SECOND", "MILLIMETER/SECOND^2", "MILLIMETER/REVOLUTION",
    "DEGREE", "DEGREE/SECOND", "DEGREE/SECOND^2", "REVOLUTION/MINUTE",
    "PERCENT", "CELSIUS", "SECOND", "NEWTON", "JOULE", "NEWTON_METER", "PASCAL", "PASCAL/SECOND",
    "PASCAL_SECOND", "AMPERE", "COULOMB", "VOLT", "WATT", "VOLT_AMPERE",
    "VOLT_AMPERE_REACTIVE", "OHM", "OHM_METER", "SIEMENS/METER", "KILOGRAM", "GRAM/CUBIC_METER",
    "LITER", "LITER/SECOND", "SQUARE_MILLIMETER", "CUBIC_MILLIMETER/SECOND^2", "COUNT",
    "COUNT/SECOND", "DECIBEL", "PH", "HERTZ", "MILLIMETER_3D", "DEGREE_3D", "UNIT_VECTOR_3D",
    "MICRO_RADIAN", "REVOLUTION/SECOND", "REVOLUTION/SECOND^2", "METER/SECOND^2", "GRAM",
    "MILLIGRAM", "MILLIGRAM/CUBIC_MILLIMETER", "MILLILITER", "CUBIC_METER", "CUBIC_MILLIMETER",
    "CUBIC_MILLIMETER/SECOND", "WATT_SECOND",
)  # fmt: skip
"""UnitEnum of MTConnect 1.0 to 2.7; of several for one dimension the first is the one on disk."""

NATIVE_UNITS = (
    "AMPERE_HOUR", "BAR", "CENTIPOISE", "CUBIC_FOOT", "CUBIC_FOOT/HOUR", "CUBIC_FOOT/MINUTE",
    "DEGREE/MINUTE", "FAHRENHEIT", "FOOT", "FOOT/MINUTE", "FOOT/SECOND", "FOOT/SECOND^2",
    "FOOT_3D", "GALLON/MINUTE", "GRAVITATIONAL_ACCELERATION", "GRAVITATIONAL_FORCE", "HOUR",
    "INCH", "INCH/MINUTE", "INCH/REVOLUTION", "INCH/SECOND", "INCH/SECOND^2", "INCH_3D",
    "INCH_POUND", "KELVIN", "KILOWATT", "KILOWATT_HOUR", "LITER/MINUTE", "MICROMETER",
    "MICROTORR", "MILLIMETER/MINUTE", "MILLIMETER_MERCURY", "MINUTE", "PASCAL/MINUTE", "POUND",
    "POUND/INCH^2", "RADIAN", "RADIAN/MINUTE", "RADIAN/SECOND", "RADIAN/SECOND^2", "RANKINE",
    "SQUARE_INCH", "TORR",
)  # fmt: skip
"""NativeUnitEnum of MTConnect 1.0 to 2.7, without OTHER, which says that the unit is not known."""

# Ordinary text for MTConnect's own units: what needs no conversion must not wait for pint.
SAME = {
    "mm": "MILLIMETER", "mm/s": "MILLIMETER/SECOND", "mm/s^2": "MILLIMETER/SECOND^2",
    "mm/s²": "MILLIMETER/SECOND^2", "mm/rev": "MILLIMETER/REVOLUTION", "deg": "DEGREE",
    "°": "DEGREE", "deg/s": "DEGREE/SECOND", "°/s": "DEGREE/SECOND", "rpm": "REVOLUTION/MINUTE",
    "RPM": "REVOLUTION/MINUTE", "1/min": "REVOLUTION/MINUTE", "U/min": "REVOLUTION/MINUTE",
    "%": "PERCENT", "percent": "PERCENT", "degC": "CELSIUS", "°C": "CELSIUS",
    "CELCIUS": "CELSIUS", "s": "SECOND", "sec": "SECOND", "N": "NEWTON", "Nm": "NEWTON_METER",
    "N*m": "NEWTON_METER", "N·m": "NEWTON_METER", "N m": "NEWTON_METER", "Pa": "PASCAL",
    "A": "AMPERE", "V": "VOLT", "W": "WATT", "J": "JOULE", "Hz": "HERTZ", "kg": "KILOGRAM",
    "dB": "DECIBEL", "pH": "PH", "-": "", "1": "", "[-]": "",
}  # fmt: skip

# Whole texts that the grammar below would misread or does not know.
WHOLE = {
    "UNIT_VECTOR": "", "MILLIMETER_MERCURY": "mmHg", "GRAVITATIONAL_ACCELERATION": "g_0",
    "GRAVITATIONAL_FORCE": "gram * g_0", "INCH_POUND": "inch * force_pound",
    "POUND/INCH^2": "psi", "MICRO_RADIAN": "microradian", "VOLT_AMPERE": "volt_ampere",
    "VOLT_AMPERE_REACTIVE": "volt_ampere_reactive", "PH": "acidity_ph", "pH": "acidity_ph",
    "1/min": "revolution / minute", "/min": "revolution / minute",
    "min-1": "revolution / minute", "min^-1": "revolution / minute",
    "min⁻¹": "revolution / minute", "1/s": "revolution / second", "s-1": "revolution / second",
    "s^-1": "revolution / second", "Upm": "revolution / minute", "ipm": "inch / minute",
    "IPM": "inch / minute", "ips": "inch / second", "ipr": "inch / revolution",
    "fpm": "foot / minute", "sfm": "foot / minute", "lpm": "liter / minute",
    "gpm": "gallon / minute", "in-lb": "inch * force_pound", "ft-lb": "foot * force_pound",
    "ft-lbs": "foot * force_pound", "in-lbf": "inch * force_pound",
    "ft-lbf": "foot * force_pound", "dB(A)": "decibel", "g_0": "g_0", "g_n": "g_0",
    "lb/in2": "psi", "lb/in^2": "psi",
}  # fmt: skip

# Names of one unit that pint lacks or reads as something that no machine tool reports.
NAMES = {
    "MM": "mm", "M": "meter", "NM": "newton * meter", "KN": "kilonewton", "KNM": "kN * meter",
    "KW": "kilowatt", "KWH": "kilowatt_hour", "KVA": "kilovolt_ampere", "KHZ": "kilohertz",
    "KPA": "kilopascal", "MPA": "megapascal", "Mpa": "megapascal", "UM": "micrometer",
    "IN": "inch", "CM": "cm", "°": "degree", "U": "revolution",
    "tr": "revolution", "rev": "revolution", "Umdr": "revolution", "pcs": "count",
    "inc": "count", "cnt": "count", "counts": "count", "Nm": "newton * meter",
    "kNm": "kilonewton * meter", "mNm": "millinewton * meter", "Ncm": "newton * centimeter",
    "Nmm": "newton * millimeter", "dBA": "decibel", "grd": "degree", "min": "minute",
    "ε": "strain", "µε": "microstrain", "με": "microstrain",
}  # fmt: skip

# One letter, two units: the other side of the conversion tells which is meant.
AMBIGUOUS = {
    "g": ("gram", "g_0"),
    "C": ("degC", "coulomb"),
    "F": ("degF", "farad"),
    "lb": ("pound", "lbf"),
    "lbs": ("pound", "lbf"),
    '"': ("inch", "arcsecond"),
}

# Of several MTConnect units for one dimension, the one that the names in the text ask for.
ASKED = (
    ("hertz", "HERTZ"),
    ("turn", "REVOLUTION/MINUTE"),
    ("revolution", "REVOLUTION/MINUTE"),
    ("newton", "NEWTON_METER"),
    ("force", "NEWTON_METER"),
)
