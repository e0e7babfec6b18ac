"""RINEX 3 text written anew in the forms of RINEX 2.11 and 4, for tests; one value at a time, after the tables of
the two format documents, and without any code of the package.
"""

from __future__ import annotations

from datetime import datetime

OTHER_SATELLITES = ("R07", "E11")


def parsed_observations(text: str, code: str = "C1C") -> tuple[list[str], list[tuple[str, dict[str, str]]]]:
    """Header lines, and of each epoch its line and the value of the code, 14 columns, by GPS satellite."""
    lines = text.splitlines()
    end = next(k for k, line in enumerate(lines) if "END OF HEADER" in line) + 1
    types = next(line for line in lines if line.startswith("G ") and "OBS TYPES" in line)[6:60].split()
    column = 3 + 16 * types.index(code)
    epochs: list[tuple[str, dict[str, str]]] = []
    for line in lines[end:]:
        if line.startswith(">"):
            epochs.append((line, {}))
        elif line.startswith("G"):
            epochs[-1][1][line[:3]] = line[column : column + 14].ljust(14)
    return lines[:end], epochs


def observations_2(text: str, *, types: tuple[str, ...] = ("L1", "L2", "C1", "P2", "D1", "S1", "S2")) -> str:
    """RINEX 2.11 with two satellites of other systems in each epoch, an event, and lines that are folded."""
    header, epochs = parsed_observations(text)
    code = "C1" if "C1" in types else "P1"
    out = [f"{'2.11':>9}           OBSERVATION DATA    M (MIXED)           RINEX VERSION / TYPE"]
    out += [line for line in header if "APPROX POSITION XYZ" in line]
    for k in range(0, len(types), 9):
        count = f"{len(types):6d}" if k == 0 else " " * 6
        out.append(f"{count + ''.join(f'    {one}' for one in types[k : k + 9]):60}# / TYPES OF OBSERV")
    out += [line for line in header if "TIME OF FIRST OBS" in line] + [f"{'':60}END OF HEADER"]
    for number, (line, values) in enumerate(epochs):
        if number == 1:
            out += [f"{'':28}4  1", f"{'something happened':60}COMMENT"]
        names = [*list(values)[:3], OTHER_SATELLITES[0], *list(values)[3:], OTHER_SATELLITES[1]]
        year, month, day, hour, minute = (int(part) for part in line[2:18].split())
        clock = f" {year % 100:02d} {month:2d} {day:2d} {hour:2d} {minute:2d}{float(line[18:29]):11.7f}  0"
        for k in range(0, len(names), 12):
            head = f"{clock}{len(names):3d}" if k == 0 else " " * 32
            out.append(head + "".join(names[k : k + 12]))
        for name in names:
            value = values.get(name, f"{2.2e7:14.3f}")
            fields = [f"{value} 7" if one == code else f"{1.23:14.3f}  " for one in types]
            # Values that are missing are blanks, and blanks at the end of a line are left out.
            out += ["".join(fields[k : k + 5]).rstrip() for k in range(0, len(fields), 5)]
    return "\n".join(out) + "\n"


def parsed_records(text: str) -> tuple[list[str], list[list[str]]]:
    """Header lines and the records of eight lines."""
    lines = text.splitlines()
    end = next(k for k, line in enumerate(lines) if "END OF HEADER" in line) + 1
    return lines[:end], [lines[k : k + 8] for k in range(end, len(lines), 8)]


def navigation_2(text: str) -> str:
    """RINEX 2.11 with the records of GPS."""
    header, records = parsed_records(text)
    out = [f"{'2.11':>9}           N: GPS NAV DATA                         RINEX VERSION / TYPE"]
    for label, name in (("GPSA", "ION ALPHA"), ("GPSB", "ION BETA")):
        values = next(line[5:53] for line in header if line.startswith(label))
        out.append(f"  {values.replace('E', 'D').replace('e', 'D')}".ljust(60) + name)
    out.append(f"{'':60}END OF HEADER")
    for record in records:
        if record[0][0] != "G":
            continue
        date = datetime.strptime(record[0][4:23], "%Y %m %d %H %M %S")
        number = int(record[0][1:3])
        first = f"{number:2d} {date.year % 100:02d} {date.month:2d} {date.day:2d} {date.hour:2d} {date.minute:2d}"
        out.append(f"{first}{date.second:5.1f}{record[0][23:]}".replace("e", "D"))
        out += [line[1:].rstrip().replace("e", "D") for line in record[1:]]
    return "\n".join(out) + "\n"


def observations_4(text: str) -> str:
    """RINEX 4.02: the first line alone is another."""
    first, rest = text.split("\n", 1)
    return f"{'4.02':>9}{first[9:]}\n{rest}"


def navigation_4(text: str) -> str:
    """RINEX 4.02 with the ionosphere in two records, and with messages that are not read between those that are."""
    header, records = parsed_records(text)
    values = [
        float(line[k : k + 12])
        for label in ("GPSA", "GPSB")
        for line in header
        if line.startswith(label)
        for k in range(5, 53, 12)
    ]
    out = [
        f"{'4.02':>9}           NAVIGATION DATA     M                   RINEX VERSION / TYPE",
        f"{'':60}END OF HEADER",
        *_ionosphere_4("2020 12 31 23 59 30", [1.5 * value for value in values]),
        "> STO GPUT LNAV".replace("GPUT", "G05"),
        f"    2020 01 01 00 00 00 {'GPUT':18} {'':18} {'UTC(USNO)':18}",
        f"    {1.0:19.12e}{2.0:19.12e}{3.0:19.12e}{4.0:19.12e}",
        *_ionosphere_4("2019 12 31 23 59 30", values),
    ]
    for number, record in enumerate(records):
        message = "LNAV" if record[0][0] == "G" else "D2" if int(record[0][1:3]) <= 5 else "D1"
        if number % 5 == 0:
            # A message of ten lines of the same satellite, with numbers that would be another orbit.
            out += [f"> EPH {record[0][:3]} {'CNAV' if message == 'LNAV' else 'CNV1'}", record[0]]
            out += [f"    {1.0:19.12e}{2.0:19.12e}{3.0:19.12e}{4.0:19.12e}"] * 8
        out += [f"> EPH {record[0][:3]} {message}", *record]
    return "\n".join(out) + "\n"


def _ionosphere_4(date: str, values: list[float]) -> list[str]:
    fields = [f"{value:19.12e}" for value in values]
    return ["> ION G10 LNAV", f"    {date}{''.join(fields[:3])}", f"    {''.join(fields[3:7])}", f"    {fields[7]}"]
