"""Decodes a device's frames from standard input, bytes as they came or a capture's journal, a line of JSON each and
one before them for a journal's header: written from docs/wire-protocol.md alone."""
import json, struct, sys, zlib

def cobs(data):
    out, at = b"", 0
    while at < len(data):
        out += data[at + 1 : at + data[at]] + (b"\0" if data[at] < 255 and at + data[at] < len(data) else b"")
        at += data[at]
    return out

class Payload:
    def __init__(self, data): self.data, self.at = data, 0
    def take(self, n): self.at += n; return self.data[self.at - n : self.at]
    def u8(self): return self.take(1)[0]
    def u(self):
        byte = self.u8()
        return byte & 127 | (self.u() << 7 if byte & 128 else 0)
    def i(self): n = self.u(); return n >> 1 ^ -(n & 1)
    def text(self): return self.take(self.u()).decode()
    def many(self, n, read): return [read() for _ in range(n)]
    def list(self, read): return self.many(self.u(), read)
    def zero(self): return [self.u(), self.u(), self.u() if self.u8() else None]
    def f32(self): return struct.unpack("<f", self.take(4))[0]
    def f24(self): return struct.unpack("<f", b"\0" + self.take(3))[0]
    def equation(self, n):
        kind = self.u()
        return [kind] + (self.many(2 * n + 2, self.f32) if kind == 0 else [self.u8()] if kind == 2 else [])
    def hello(self): return [self.many(4, self.u), self.text(), self.text(), self.u(), self.list(self.u), self.u8(), self.many(5, self.u), self.list(self.zero), self.u(), self.text(), self.list(self.u8), self.many(3, self.u), self.many(2, self.u)]
    def samples(self): return [self.many(4, self.u), self.list(self.i), self.list(self.i)]
    def status(self): return [self.many(12, self.u), self.list(self.u), self.list(self.i), self.u()]
    def ack(self): command, result = self.u(), self.u(); return [command, result] + ([self.u()] if result == 1 else [])
    def log(self): return [self.u(), self.u8(), self.text()]
    def estimate(self): return [self.many(6, self.u), self.equation(6), self.equation(5)]
    def rows(self): return [self.many(5, self.u), self.many(2, self.u8), self.list(lambda: self.many(13, self.f24))]
    def back_filled(self): return self.many(3, self.u)
    def component(self): return [self.u8(), self.u(), self.u()]
    def excited(self): return [self.many(3, self.u), self.u8(), self.many(10, self.u), self.u8(), self.u(), self.many(6, self.component), self.u8(), self.many(2, self.u)]

bytes_in, magic = sys.stdin.buffer.read(), b"whirl-frames 1 "
if bytes_in.startswith(magic):
    header, bytes_in = bytes_in[len(magic) :].split(b"\0", 1)
    print(json.dumps(json.loads(header)))
for frame in bytes_in.split(b"\0")[:-1]:
    if not frame:
        continue
    checked = cobs(frame)
    payload, crc = checked[:-4], checked[-4:]
    assert zlib.crc32(payload) == int.from_bytes(crc, "little")
    p = Payload(payload)
    sequence, message = p.u(), p.u()
    fields = [p.hello, p.samples, p.status, p.ack, p.log, p.estimate, p.rows, p.samples, p.back_filled, p.excited][message]()
    assert p.at == len(payload), (message, p.at, len(payload))
    print(json.dumps([sequence, message, fields]))
