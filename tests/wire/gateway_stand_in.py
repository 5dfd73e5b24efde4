"""Simulated publications of a gateway: states of several axes at a steady rate with known values,
losses and faults, and answers to commands. A process of its own for the tests of monitor, logs and
client.

    gateway_stand_in.py --url URL --axes 1,2 --rate 50 --count 100 --drop 7 --double 11

State number k of axis n has force k / 256 counts, position 1000 n + k and so on (`state_of`);
`--drop 7` numbers but does not send every k with k % 7 == 3, `--double 11` sends k % 11 == 5 twice.
"""

import argparse
import math
import time

import lcm
from forceaxis.bus.lcm import NOT_AVAILABLE, TABLE_HASH, blank, channel_of, decode, new_run_id
from forceaxis.bus.messages import (
    axis_capture_t,
    axis_command_t,
    axis_event_t,
    axis_state_t,
    sim_clock_t,
    sim_truth_t,
)

OPERATION_ENABLED, FAULT, DISABLED = 0x1637, 0x0218, 0x0250
SCALE_UN = 1_960_000  # 1.96 N a count, as the thesis's sensor


def state_of(axis, k, faulty=False, mismatch=False):
    """The state number k of an axis; what is not set here is not available."""
    s = blank(axis_state_t)
    s.axis, s.tick, s.utime = axis, 30 * k, 20_000 * k
    s.objects_hash = 0x1234ABCD if mismatch else TABLE_HASH
    s.nmt_state, s.age_us = s.NMT_OPERATIONAL, 1000
    s.statusword = FAULT if faulty else OPERATION_ENABLED if axis != 3 else DISABLED
    s.mode_display, s.native_mode = 10 if axis != 3 else 1, 3 if axis != 3 else 0
    s.fault, s.error_code = (6, 0xFF06) if faulty else (0, 0)
    s.limit_reason = 1 if axis == 2 else 0
    s.contact, s.limit_cycle = int(axis != 3), int(axis == 2)
    s.position_cnt, s.velocity_cnt_per_s = 1000 * axis + k, 50 * axis
    s.target_position_cnt = 1000 * axis
    s.force_cnt_q8, s.force_permille = k, k % 1000
    s.target_force_permille = 500
    s.rated_force_mN, s.force_scale_uN = 118_000, SCALE_UN
    s.dac_code, s.command_code = k % 2048, k % 2048 + axis
    s.num_more, s.more_name, s.more_value = 1, ["force_gain"], [256 * axis]
    return s


def lively(s, axis, k):
    """The same with plausible values, for screenshots."""
    t = k / 50
    wave = (
        math.exp(-0.4 * (t % 8)) * math.sin(2 * math.pi * 1.3 * t) if axis != 2 else math.sin(9 * t)
    )
    f = 30 + (6 if axis == 2 else 14) * wave
    s.force_cnt_q8, s.target_force_permille = round(256 * max(0, f)), 498
    s.force_permille = round(max(0, f) * 1.96 / 118 * 1000)
    s.position_cnt = round(36_000 * axis + 400 * math.sin(0.5 * t) + 20 * wave)
    s.target_position_cnt = 36_000 * axis + round(400 * math.sin(0.5 * t + 0.1))
    s.dac_code = max(-300, min(300, round(5 * 256 * (30 - f) / 256 * 4)))
    s.command_code = round(5 * 256 * (30 - f) / 256 * 4)
    s.velocity_cnt_per_s = round(200 * math.cos(0.5 * t))


class Gateway:
    def __init__(self, url, axes):
        self.lcm, self.run_id, self.seq = lcm.LCM(url), new_run_id(), {}
        self.values, self.answers, self.captures = {}, {}, dict.fromkeys(axes, 0)
        self.done = []  # executed commands
        for axis in axes:
            subscription = self.lcm.subscribe(f"AXIS_{axis}_COMMAND", self.command)
            subscription.set_queue_capacity(1000)

    def send(self, channel, message, drop=False, double=False):
        message.run_id, message.seq = self.run_id, self.seq.get(channel, 0)
        message.wall_utime = time.time_ns() // 1000
        self.seq[channel] = message.seq + 1
        for _ in range(0 if drop else 2 if double else 1):
            self.lcm.publish(channel, message.encode())

    def event(self, axis, kind, text, code=NOT_AVAILABLE, command=None, items=()):
        e = blank(axis_event_t)
        e.axis, e.kind, e.code, e.text = axis, kind, code, text
        if command:
            e.command_run_id, e.command_id = command.run_id, command.command_id
        e.num_items = len(items)
        e.object, e.value = [n for n, _ in items], [v for _, v in items]
        self.send(f"AXIS_{axis}_EVENT", e)
        return e

    def command(self, channel, data):
        c, (axis, _) = decode(channel, data), channel_of(channel)
        key = (c.run_id, c.command_id)
        if key in self.answers:  # a repeated command: the same response
            self.event(*self.answers[key])
            return
        self.done.append(key)
        items = list(zip(c.object, c.value, strict=True))
        kind, text, code = axis_event_t.EVENT_DONE, "done", 0
        if c.kind == axis_command_t.KIND_WRITE:
            for i, (name, value) in enumerate(items):
                if name == "position":
                    kind, code = axis_event_t.EVENT_REFUSED, 0x06010002
                    text, items = "position: read-only", items[: i + 1]
                    break
                self.values[axis, name] = value
        elif c.kind == axis_command_t.KIND_REPEAT:
            text, items = self.repeat(axis, c)
        elif c.kind == axis_command_t.KIND_READ:
            items = [(n, self.values.get((axis, n), 0)) for n, _ in items]
        arguments = (axis, kind, text, code, c, items)
        self.answers[key] = arguments
        if (
            len(self.done) % 5 != 3
        ):  # otherwise the response is lost: the client repeats its command
            self.event(*arguments)
        if c.kind == axis_command_t.KIND_CAPTURE:
            self.values[axis, "recorder_state"] = 1  # armed
            self.latest = c, 0
            if dict(items).get("recorder_trigger_level") == 2**31 - 1:
                return  # no force fires that
            self.capture(axis, c, dict(items).get("recorder_length") or 100)

    def capture(self, axis, command, total, lose=None):
        """`total` samples of the command's signals, sample i of signal j being 100 j + i."""
        self.captures[axis] += 1
        self.latest = command, total
        self.blocks(axis, command, total, 0, total, lose)
        self.event(axis, axis_event_t.EVENT_CAPTURE, f"capture of {total} samples", total, command)

    def blocks(self, axis, command, total, start, end, lose=None):
        names = command.signal if command else ["force", "dac_code"]
        for first in range(start, end, 64):
            b = blank(axis_capture_t)
            b.axis, b.capture_id, b.decimation = axis, self.captures[axis], 1
            if command:
                b.command_run_id, b.command_id = command.run_id, command.command_id
            b.first_sample, b.total_samples, b.trigger_sample = first, total, total // 10
            b.first_tick, b.utime = 3000 + first, (3000 + first) * 2000 // 3
            b.num_signals, b.signal = len(names), list(names)
            b.num_samples = min(64, end - first)
            b.value = [
                [sample(axis, n, i) for n in range(len(names))]
                for i in range(first, first + b.num_samples)
            ]
            self.send(f"AXIS_{axis}_CAPTURE", b, drop=first // 64 == lose)

    def repeat(self, axis, command):
        """Sends samples of the latest capture again: (text, items) of the answer."""
        (_, number), *bounds = zip(command.object, command.value, strict=True)
        latest, _ = self.latest
        assert (command.run_id, number) == (latest.run_id, latest.command_id)
        for (_, first), (_, end) in zip(bounds[::2], bounds[1::2], strict=True):
            self.blocks(axis, *self.latest, first, min(end, self.latest[1]))
        return "samples are sent again", [("total_samples", self.latest[1])]

    def clock_and_truth(self, k):
        c = blank(sim_clock_t)
        c.utime, c.tick, c.clock_state, c.speed_permille = 20_000 * k, 30 * k, c.CLOCK_RUNNING, 1000
        self.send("SIM_CLOCK", c)
        t = sim_truth_t()
        t.utime, t.axis, t.first_tick, t.decimation = 20_000 * k, 1, 30 * k, 1
        t.signal, t.unit = ["robot.position", "sensor.force"], ["m", "N"]
        t.num_signals, t.num_samples = 2, 30
        t.value = [[truth(30 * k + i, 0), truth(30 * k + i, 1)] for i in range(30)]
        self.send("SIM_TRUTH", t)


def sample(axis, signal, i):
    return 100 * signal + i + axis


def truth(tick, signal):
    return (tick + 1) / 7 + signal


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--url", required=True)
    parser.add_argument("--axes", default="1")
    parser.add_argument("--rate", type=float, default=50)
    parser.add_argument("--count", type=int, default=10**9)
    parser.add_argument("--drop", type=int, default=0)
    parser.add_argument("--double", type=int, default=0)
    parser.add_argument("--fault", type=int, default=0, help="axis with a fault")
    parser.add_argument("--mismatch", type=int, default=0, help="axis with another table")
    parser.add_argument("--dead", default="", help="AXIS:NMT,...: axes without a value for 8.1 s")
    parser.add_argument("--capture", type=int, default=0, help="samples of a capture of axis 1")
    parser.add_argument("--lively", action="store_true")
    args = parser.parse_args()
    axes = [int(a) for a in args.axes.split(",")]
    dead = dict(map(int, words.split(":")) for words in args.dead.split(",") if words)
    gateway, start = Gateway(args.url, axes), time.monotonic()
    print("ready", flush=True)
    for k in range(args.count):
        while (remaining := start + k / args.rate - time.monotonic()) > 0:
            gateway.lcm.handle_timeout(max(1, int(remaining * 1000)))
        for axis in axes:
            s = state_of(axis, k, axis == args.fault, axis == args.mismatch)
            if args.lively:
                lively(s, axis, k)
            if axis in dead:  # as a gateway goes on after a node is lost: its last values
                s.nmt_state, s.age_us = dead[axis], 8_100_000
            drop = args.drop and k % args.drop == 3
            double = args.double and k % args.double == 5
            gateway.send(f"AXIS_{axis}_STATE", s, drop, double)
        if k == 10:
            for axis in axes:
                if axis == args.fault:
                    gateway.event(axis, axis_event_t.EVENT_EMCY, "EMCY FF06h: force_max", 0xFF06)
                    gateway.event(axis, axis_event_t.EVENT_FAULT, "fault force_max", 6)
                if axis == args.mismatch:
                    gateway.event(
                        axis,
                        axis_event_t.EVENT_TABLE_MISMATCH,
                        f"object table 1234abcd in the firmware, {TABLE_HASH:08x} here: "
                        "writes are refused",
                        0x1234ABCD,
                    )
            gateway.event(axes[0], axis_event_t.EVENT_DRIVE_STATE, "operation enabled", 0x1637)
            gateway.event(axes[0], axis_event_t.EVENT_MODE, "mode cyclic force", 10)
        if args.capture and k == 20:
            gateway.capture(axes[0], None, args.capture)
        if k % 5 == 0:
            gateway.clock_and_truth(k)


if __name__ == "__main__":
    main()
