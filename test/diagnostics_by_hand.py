"""DiagnosticArray laid out by the rules of CDR, without this package."""

import struct


def diagnostics(values, hardware="simulation"):
    """The bytes of one status with these values of a node /driveline."""
    body = bytearray(b"\x00\x01\x00\x00" + struct.pack("<iI", 5, 0))

    def text(word):
        body.extend(b"\0" * (-len(body) % 4))
        data = str(word).encode() + b"\0"
        body.extend(struct.pack("<I", len(data)) + data)

    def count(number):
        body.extend(b"\0" * (-len(body) % 4))
        body.extend(struct.pack("<I", number))

    text("")
    count(1)
    body.extend(b"\x01")
    for word in ("/driveline: driveline", "missed", hardware):
        text(word)
    count(len(values))
    for key, value in values.items():
        text(key)
        text(value)
    return bytes(body)
