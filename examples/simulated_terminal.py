"""A valve terminal that does not exist, to try own_driver.py with: python examples/simulated_terminal.py [PORT].

Modbus/TCP on loopback. Holding registers: 0 to 15 spools, signed, 10000 fully open to fill; 16 supply valve, 1 open;
17 watchdog [ms]; 100 to 115 analogue inputs, 12 bit of 5 V. Functions: 3 read, 16 write, 23 write and read. When
nothing is written for the watchdog's time it closes the spools, and for four times that the supply.
"""

import socketserver
import struct
import sys
import threading
import time

import numpy as np

PORT = 5020
SPOOLS, SUPPLY_VALVE, WATCHDOG_MS, ANALOGUE, COUNT = 0, 16, 17, 100, 16
READ, WRITE, WRITE_AND_READ = 3, 16, 23
ILLEGAL_FUNCTION, ILLEGAL_ADDRESS = 1, 2
SUPPLY_PA, TIME_CONSTANT_S, VOLT_PER_PA = 200e3, 0.25, 4.0 / 200e3
ADC_COUNTS, ADC_REFERENCE_V, NOISE_V = 4096, 5.0, 0.002


class Device:
    """Sixteen chambers behind sixteen valves, and the registers through which they are reached."""

    def __init__(self) -> None:
        """Start vented, with a watchdog of 50 ms."""
        self.registers = np.zeros(ANALOGUE + COUNT, dtype=np.uint16)
        self.registers[WATCHDOG_MS] = 50
        self.pressure_pa, self.noise = np.zeros(COUNT), np.random.default_rng(0)
        self._written_s = self._now_s = time.monotonic()
        self._lock = threading.Lock()

    @property
    def spools(self) -> np.ndarray:
        """Openings now, -1 to +1."""
        return self.registers[SPOOLS : SPOOLS + COUNT].astype(np.int16) / 10000.0

    def answer(self, function: int, data: bytes) -> bytes:
        """Return the answer to a request, its function's code first."""
        with self._lock:
            self._advance(time.monotonic())
            if function == READ:
                return bytes([function]) + self._read(*struct.unpack(">HH", data))
            if function == WRITE:
                first, count, _ = struct.unpack(">HHB", data[:5])
                return self._write(first, count, data[5:]) or bytes([function]) + data[:4]
            if function == WRITE_AND_READ:
                read_first, read_count, first, count, _ = struct.unpack(">HHHHB", data[:9])
                refused = self._write(first, count, data[9:])
                return refused or bytes([function]) + self._read(read_first, read_count)
            return bytes([function | 0x80, ILLEGAL_FUNCTION])

    def _write(self, first: int, count: int, data: bytes) -> bytes:
        if first + count > ANALOGUE:
            return bytes([WRITE | 0x80, ILLEGAL_ADDRESS])
        self.registers[first : first + count] = np.frombuffer(data, dtype=">u2", count=count)
        self._written_s = time.monotonic()
        return b""

    def _read(self, first: int, count: int) -> bytes:
        values = self.registers[first : first + count]
        return bytes([2 * len(values)]) + values.astype(">u2").tobytes()

    def _advance(self, now_s: float) -> None:
        """Let the air flow until now; the watchdog closes what it has to."""
        watchdog_s, silence_s = 1e-3 * float(self.registers[WATCHDOG_MS]), now_s - self._written_s
        flows_s = max(min(now_s, self._written_s + watchdog_s) - self._now_s, 0.0)
        spools = self.spools
        toward_pa = np.where(spools > 0.0, SUPPLY_PA * float(self.registers[SUPPLY_VALVE]), 0.0)
        share = 1.0 - np.exp(-np.abs(spools) * flows_s / TIME_CONSTANT_S)
        flowing = (spools < 0.0) | (toward_pa > self.pressure_pa)
        self.pressure_pa += np.where(flowing, share * (toward_pa - self.pressure_pa), 0.0)
        if silence_s > watchdog_s:
            self.registers[SPOOLS : SPOOLS + COUNT] = 0
        if silence_s > 4.0 * watchdog_s:
            self.registers[SUPPLY_VALVE] = 0
        volts = 0.5 + VOLT_PER_PA * self.pressure_pa + self.noise.normal(0.0, NOISE_V, COUNT)
        counts = np.rint(volts / ADC_REFERENCE_V * ADC_COUNTS).clip(0, ADC_COUNTS - 1)
        self.registers[ANALOGUE : ANALOGUE + COUNT] = counts.astype(np.uint16)
        self._now_s = now_s


class Connection(socketserver.StreamRequestHandler):
    """One client."""

    disable_nagle_algorithm = True

    def handle(self) -> None:
        """Answer until it hangs up."""
        self.server.connections.append(self.connection)
        while len(head := self.rfile.read(8)) == 8:
            number, protocol, length, unit, function = struct.unpack(">HHHBB", head)
            answer = self.server.device.answer(function, self.rfile.read(length - 2))
            self.wfile.write(struct.pack(">HHHB", number, protocol, len(answer) + 1, unit) + answer)


class SimulatedTerminal(socketserver.ThreadingTCPServer):
    """The terminal on the network, of loopback alone."""

    allow_reuse_address, daemon_threads = True, True

    def __init__(self, port: int = 0) -> None:
        """Listen on a port; on any that is free by default."""
        super().__init__(("127.0.0.1", port), Connection)
        self.device, self.connections = Device(), []


if __name__ == "__main__":
    with SimulatedTerminal(int(sys.argv[1]) if len(sys.argv) > 1 else PORT) as terminal:
        print(f"a terminal of sixteen valves on 127.0.0.1:{terminal.server_address[1]}; Ctrl-C ends it", flush=True)
        try:
            terminal.serve_forever()
        except KeyboardInterrupt:
            print()
