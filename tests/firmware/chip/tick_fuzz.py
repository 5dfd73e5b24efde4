"""A random master, bus and plant around the firmware. All events follow from the seed, the tick and
the outputs alone, so that every side receives the same ones.

A scenario lasts some hundred ticks: a mode of operation, a mapping of the PDOs, timers, the
recorder's channels. In it controlwords, targets, parameters, frames of every kind, Modbus requests,
resets and broken sensors come at random.
"""

import random
import struct

from cortex_m4 import LOCAL, NODE
from cycle_programs import random_program
from force_banks import random_bank
from pymodbus.framer import FramerRTU

MODES = [1, 3, 4, 6, 8, 9, 10, 0, -1, -2, -3, -4, -5, -6, -7, -8, -9]
CANOPEN = 0  # FW_SOURCE_
CYCLE_BUSY = 7  # of cycle_check_t
SCENARIO_TICKS = 160
FIRST_MOTION_TICKS = 520
COMMANDS = [0x00, 0x02, 0x06, 0x07, 0x0F, 0x0F, 0x0F, 0x0F, 0x1F, 0x3F, 0x5F, 0x10F, 0x80, 0x20F]
COMMANDS += [0x21F]
# Values that reach every branch: small and large, both rails, their neighbours, and off.
VALUES = {
    "target_position": [0, 100, -3000, 50000, 2147483647, -2147483648],
    "target_velocity": [0, 1, -3000, 15000, 3072000, -3072000],
    "target_force": [0, 100, 750, -500, 32767, -32768],
    "trajectory_velocity": [1, 3000, 30000, 3072000],
    "trajectory_acceleration": [35, 225000, 575000000],
    "trajectory_deceleration": [2250, 225000, 575000000],
    "quick_stop_deceleration": [35, 225000, 2250000, 575000000],
    "velocity_max": [15000, 300000, 3072000, 3072000],
    "quick_stop_option": [0, 1, 2, 5, 6],
    "fault_reaction_option": [0, 1, 2],
    "abort_connection_option": [0, 1, 2, 3],
    "shutdown_option": [0, 1],
    "disable_operation_option": [0, 1],
    "halt_option": [1, 2],
    "position_limit_min": [-2147483648, -2147483648, -4000],
    "position_limit_max": [2147483647, 2147483647, 6000],
    "following_error_window": [0xFFFFFFFF, 0xFFFFFFFF, 2000, 10],
    "following_error_timeout": [0, 2, 20],
    "interpolation_period": [0, 2, 20],
    "stiffness": [0, 32768, 2147483647],
    "damping": [0, 1280, 2147483647],
    "force_scale": [1, 2500000, 2147483647],
    "rated_force": [1, 100000, 2147483647],
    "force_slope": [1, 10000, 2147483647],
    "contact_force": [0, 256, 2560],
    "approach_velocity_max": [1, 3000, 3072000],
    "limit_cycle_losses": [0, 1, 3],
    "force_railed_time": [0, 0, 20, 10000],
    "force_jump_max": [0, 0, 30000, 65536],
    "force_stuck_travel": [0, 0, 2000, 65535],
    "force_stuck_time": [1, 100],
    "force_disconnected_code": [0, 0, 1, 2047],
    "force_disconnected_time": [20, 10000],
    "force_disconnected_travel": [0, 4, 65535],
    "tare_band": [0, 0, 512],
    "calibration_validity": [0, 0, 365],
    "date": [0, 15000],
    "inputs_fitted": [0, 30, 30],
    "homing_method": [0, 35, 37, -1, -1, 17, 18, 19, 20, 21, 22, 33, 34],
    "force_limit_positive": [65535, 65535, 300],
    "force_limit_negative": [65535, 65535, 0],
    "force_shaper_impulses": [0, 1, 2, 3, 3],
    "force_shaper_amplitude_1": [32768, 32768, 65536],
    "force_shaper_amplitude_2": [32768],
    "force_shaper_delay_2": [1, 20],
    "force_shaper_delay_3": [255],
    "motion_shaper_impulses": [0, 1, 2, 3, 3],
    "motion_shaper_amplitude_1": [32768, 32768, 65536],
    "motion_shaper_amplitude_2": [32768],
    "motion_shaper_delay_2": [1, 20],
    "motion_shaper_delay_3": [255],
    "certificate_required": [0, 0, 1],
    "uncertified_force": [0, 500, 1000],
    "uncertified_output": [0, 512, 2048],
    "homing_travel": [1, 500, 1000000, 1000000],
    "homing_timeout": [1, 100, 60000, 60000],
    "homing_retract": [1, 20, 500],
    "homing_speed_1": [1, 3000, 30000],
    "homing_speed_2": [1, 1500, 3000],
    "feed": [0, 0, 1, 10000, 2147483647],
    "gear_shaft_revolutions": [1, 1, 7],
    "velocity_offset": [0, 1500, -3072000],
    "force_offset": [0, 50, -32768],
    "home_offset": [0, 1234, -2147483648],
    "polarity": [0, 0, 64, 128, 192],
    "position_window": [0, 10, 0xFFFFFFFF],
    "position_window_time": [0, 2, 10],
    "velocity_window_time": [0, 2, 10],
    "velocity_threshold_time": [0, 2, 10],
    "open_loop_code": [-2048, -1, 0, 700, 2047],
    "excitation_waveform": [0, 1],
    "excitation_amplitude": [0, 300, 2048],
    "excitation_hold": [1, 2, 65535],
    "excitation_frequency": [0, 70000000, 2147483647],
    "excitation_sweep": [-30000, 0, 30000],
    "excitation_period": [0, 2, 10],
    "force_gain": [0, 256, 1280, 65535],
    "force_setpoint": [-65536, 0, 3840, 65536],
    "force_zero_code": [0, 0, 128],
    "force_sign": [1, 1, -1],
    "adc_bits": [8, 8, 12, 16],
    "dac_bits": [12, 12, 16],
    "position_gain": [0, 256, 1280, 65535],
    "velocity_gain": [0, 256, 2000, 65535],
    "profile_enable": [0, 1, 1],
    "profile_velocity_max": [1, 65536, 134217728],
    "profile_acceleration_max": [1, 6554, 16777216],
    "position_min": [-2147483648, -2147483648, -1000],
    "position_max": [2147483647, 2147483647, 1000],
    "output_limit": [100, 2047, 2048, 2048],
    "latency_ticks": [0, 1],
    "output_bias": [0, 0, 16384, -4806],
    "brake_engage_ticks": [0, 0, 0, 2],
    "bump_decay_shift": [0, 1, 6, 12],
    "following_error_max": [0, 0, 0, 30, 2147483647],
    "speed_max": [0, 0, 0, 40, 2147483647],
    "force_max": [0, 0, 0, 50000, 131072],
    "touch_velocity_max": [0, 0, 3000, 3072000],
    "contact_travel_max": [0, 2147483647],
    "approach_timeout": [0, 1000000000],
    "approach_travel_max": [0, 2147483647],
    "contact_unstable_option": [0, 1, 1, 2],
    "limit_cycle_window": [1, 20, 100],
    "force_ripple_max": [0, 1, 2560],
    "force_ripple_time": [1, 100],
    "watchdog": [10, 20, 1000, 65535],
    "producer_heartbeat_time": [0, 1, 2, 10],
    "error_behaviour": [0, 1, 2],
    "emcy_inhibit_time": [0, 0, 10, 100],
    "recorder_decimation": [1, 1, 2],
    "recorder_trigger_edge": [0, 1, 2, 3],
    "recorder_trigger_level": [0, 100, -100],
    "recorder_pretrigger": [0, 5],
    "recorder_length": [0, 0, 20],
    "error_history_count": [0],
}
FIRST_MOTION = {
    "first_motion_code": [1, 30, 100, 100, 2047],
    "first_motion_counts": [2, 16, 16, 4096],
    "first_motion_speed": [1, 16, 16, 2048],
    "contact_force": [512],
    "position_gain": [0, 256, 256, 256, 256, 256, 1280, 1280],
}
EXCITED_MODES = (4, 10, -1)
NATIVE_POSITION = -4
CYCLE = -9
CYCLE_TICKS = 500  # of a scenario in which the axis runs cycles
PARTS = 100  # after a reset the parts are counted anew
PROFILE = ("profile_velocity_max", "profile_acceleration_max")
# Values of a drive with a control loop of its own, in the scenarios that have one.
FITTED_DRIVE = {
    "drive_on_ticks_max": [1, 20, 600],
    "position_age_max": [0, 15, 254],
    "force_age_max": [0, 15, 254],
}
# An axis in which most phases of a cycle can be done.
CYCLE_VALUES = {
    "cycle_age_max": [0, 3, 254],
    "homing_method": [37],
    "position_gain": [1280],
    "force_gain": [256, 1280],
    "adc_bits": [8],
    "force_zero_code": [0],
    "force_sign": [1],
    "contact_force": [512],
    "cycle_lock_on_bad": [0, 0, 1],
    "cycle_bad_in_row_max": [0, 0, 2],
    "force_tare": [0],
    "tare_band": [0, 65536, 65536],
    "position_limit_min": [-2147483648],
    "position_limit_max": [2147483647],
    "position_min": [-2147483648],
    "position_max": [2147483647],
    "speed_max": [0],
    "force_max": [0, 0, 0, 50000],
    "following_error_max": [0],
    "limit_cycle_losses": [0],
    "inputs_fitted": [0],
    "certificate_required": [0],
    "contact_travel_max": [0],
    "approach_timeout": [0, 1000],
    "trajectory_acceleration": [575000000],
}
EXCITATION = {
    "excitation_point": [0, 1],
    "excitation_code": [0, 100, 2048],
    "excitation_force": [0, 1024, 65535],
    "excitation_ramp": [0, 10, 100],
    "excitation_force_max": [33554432, 33554432, 25600],
    "excitation_force_min": [-33554432, -33554432, 2560],
    "excitation_travel": [0, 20, 2147483647],
}
SIZES = {"u8": 1, "i8": 1, "u16": 2, "i16": 2, "u32": 4, "i32": 4}


def signed(value):
    return (value + (1 << 31)) % (1 << 32) - (1 << 31)


def crc(frame):
    """The frame and its CRC."""
    return frame + FramerRTU.compute_CRC(frame).to_bytes(2, "big")


class Fuzz:
    """One run: `step` plays a tick to a side (or several, which must answer alike) and reports
    the events to `watch`."""

    # Shares of the scenarios with a tested first motion, with a new program and with cycles, and of
    # the programs with phases of short_phase().
    calm_share, program_share, cycle_share, short_share = 0.07, 0.5, 0.08, 0.25

    def __init__(self, objects, seed):
        self.objects = objects
        self.rng = random.Random(seed)
        self.tick_number = 0
        self.scenario_end = 0
        self.calm_rng = random.Random(seed + 1)
        self.excite_rng = random.Random(seed + 2)
        self.tare_rng = random.Random(seed + 3)
        self.profile_rng = random.Random(seed + 4)
        self.drive_rng = random.Random(seed + 6)
        self.cycle_rng = random.Random(seed + 7)
        self.cycles = (
            False  # the axis runs cycles, by a master that leaves them alone for some time
        )
        self.fitted, self.enabled_ticks, self.drive_on_after = False, 0, 0
        self.calm = False  # the first motion is tested, by a plant that lets it begin
        self.encoder_sign = 1
        self.din = 1
        self.position, self.speed, self.wall = 0.0, 0.0, 2000.0
        self.mode = 1
        by = objects.values()
        self.readable = [o for o in by if o.mappable and o.access != "wo"]
        self.writable = [o for o in by if o.mappable == 1 and o.access != "ro"]
        self.short = [o for o in self.readable if SIZES[o.type] == 1]
        self.fast = [objects[n] for n in ("position", "velocity", "tick_count", "position_actual")]
        self.recordable = [o for o in by if o.access != "wo" and o.part in ("axis", "drive")]
        self.quiet = True
        self.requests = [
            crc(bytes([NODE, 4, 0, 0, 0, 14])),
            crc(bytes([NODE, 3, 0, 0, 0, 1])),
            crc(bytes([NODE, 8, 0, 0, 1, 2])),
        ]

    # The master.

    def set(self, side, name, value, source=LOCAL):
        return side.write(source, self.objects[name].number, signed(value))

    def start_scenario(self, side):
        rng = self.rng
        # Remains of the previous scenario must not delay this one.
        self.set(side, "controlword", 0)
        self.set(side, "mode", 0)
        self.set(side, "fault_reset", 1)
        self.set(side, "controlword", 0x80)
        self.set(side, "command_source", rng.choice([0, 0, 0, 0, 1, 2]))
        if rng.random() < 0.4:
            for name, values in VALUES.items():
                self.set(side, name, rng.choice(values))
        else:
            for name in rng.sample(list(VALUES), 8):
                self.set(side, name, rng.choice(VALUES[name]))
        self.choose_law(side)
        side.receive(0, bytes([128, NODE]))
        self.map_pdos(side)
        self.watch_nodes(side)
        side.receive(0, bytes([rng.choice([1, 1, 1, 1, 1, 1, 128, 2]), NODE]))
        self.choose_channels(side)
        self.quiet = rng.random() < 0.3
        self.mode = rng.choice(MODES)
        self.set(side, "modes_of_operation", self.mode)
        for name, values in EXCITATION.items():
            self.set(side, name, self.excite_rng.choice(values))
        self.start_drive(side)
        self.start_first_motion(side)
        self.start_cycles(side)
        if self.tare_rng.random() < 0.05:
            self.set(side, "tare_averaging", self.tare_rng.choice([1, 3, 6]))
            self.set(side, "tare", 1)  # the axis stays disabled for it
            return
        for word in (0x06, 0x0F):
            self.set(side, "controlword", word)

    def choose_law(self, side):
        """A bank of up to three sections in force, where the ADC bears it, or none."""
        rng = self.rng
        self.set(side, "force_bank", 0)
        if rng.random() < 0.5:
            return
        for name, value in random_bank(rng):
            self.set(side, name, value)

    def start_first_motion(self, side):
        rng = self.calm_rng
        self.calm = rng.random() < self.calm_share
        self.set(side, "first_motion_test", int(self.calm))
        if self.calm:
            for name, values in FIRST_MOTION.items():
                self.set(side, name, rng.choice(values))
            self.wall = self.position + rng.choice([-40, -10, 10, 1000, 1000])
            self.encoder_sign = rng.choice([1, 1, 1, 1, -1, 0])
            self.din = rng.choice([1, 1, 1, 3, 5])
        self.scenario_end = self.tick_number + (FIRST_MOTION_TICKS if self.calm else SCENARIO_TICKS)

    def start_cycles(self, side):
        """A program in some scenarios; in some of them the axis runs it several times."""
        rng = self.cycle_rng
        if rng.random() < self.program_share:
            program = random_program(rng, signed(int(self.position)), self.short_share)
            answer = side.select_program(program)
            assert answer in (0, CYCLE_BUSY), f"reason and part {divmod(answer, 256)[::-1]}"
        self.cycles = not self.calm and rng.random() < self.cycle_share
        if not self.cycles:
            return
        self.scenario_end = self.tick_number + CYCLE_TICKS
        for name, values in CYCLE_VALUES.items():
            self.set(side, name, rng.choice(values))
        self.mode = CYCLE
        self.set(side, "modes_of_operation", CYCLE)

    def run_cycle(self, side):
        """Starts a cycle where none runs, on an axis that is switched on again where it is off."""
        for number in range(1, PARTS):
            self.set(side, "cycle_acknowledge", number)
        words = (0x0F, 0x1F) if side.outputs[2] else (0x00, 0x80, 0x06, 0x0F, 0x1F)
        for word in words:
            self.set(side, "controlword", word)

    def map_pdos(self, side):
        rng = self.rng
        style = rng.choice(["default", "short", "fast", "any", "any"])
        if style == "default":
            return
        for pdo in range(1, 5):
            self.map_one(side, "tpdo", pdo, style)
            if rng.random() < 0.5:
                self.map_one(side, "rpdo", pdo, style)

    def map_one(self, side, kind, pdo, style):
        rng = self.rng
        name = f"{kind}_cob_id_{pdo}"
        no_rtr = 0x40000000  # a TPDO that is not sent on request
        cob_id = (no_rtr | 0x180 if kind == "tpdo" else 0x200) + 0x100 * (pdo - 1) + NODE
        self.set(side, name, cob_id | 0x80000000)
        self.set(side, f"{kind}_mapped_{pdo}", 0)
        among = {"short": self.short, "fast": self.fast, "any": self.readable}[style]
        among = among if kind == "tpdo" else self.writable
        room, entries = 8, []
        while room and len(entries) < 8:
            o = rng.choice(among)
            if SIZES[o.type] > room:
                among = [o for o in among if SIZES[o.type] <= room]
                if not among:
                    break
                continue
            entries.append(o.index << 16 | o.sub << 8 | 8 * SIZES[o.type])
            room -= SIZES[o.type]
            if style == "any" and rng.random() < 0.1:
                break
        for i, entry in enumerate(entries):
            self.set(side, f"{kind}_mapping_{8 * (pdo - 1) + i + 1}", entry)
        self.set(side, f"{kind}_mapped_{pdo}", len(entries))
        slow = rng.random() < 0.25
        self.set(side, f"{kind}_transmission_{pdo}", rng.choice([0, 1, 3]) if slow else 255)
        if kind == "tpdo":
            self.set(side, f"tpdo_event_time_{pdo}", rng.choice([0, 0, 1, 2, 20]))
            self.set(side, f"tpdo_inhibit_time_{pdo}", rng.choice([0, 0, 0, 7, 20, 100]))
        else:
            self.set(side, f"rpdo_timeout_{pdo}", rng.choice([0, 0, 0, 0, 5, 50]))
        self.set(side, name, cob_id)

    def watch_nodes(self, side):
        rng = self.rng
        for i in range(4):
            watched = rng.random() < 0.15
            entry = (20 + i) << 16 | rng.choice([5, 20]) if watched else 0
            self.set(side, f"consumer_heartbeat_{i + 1}", entry)

    def choose_channels(self, side):
        rng = self.rng
        self.set(side, "recorder_arm", 0)
        count = rng.choice([0, 3, 8, 8, 8])
        for i in range(8):
            o = rng.choice(self.recordable)
            value = o.index << 8 | o.sub if i < count else 0
            self.set(side, f"recorder_signal_{i + 1}", value)
        o = rng.choice(self.recordable)
        self.set(side, "recorder_trigger_source", o.index << 8 | o.sub)
        self.set(side, "recorder_arm", 1)

    def command(self, side):
        """A random action of the master between two ticks."""
        rng = self.rng
        chance = rng.random()
        often = 0.05 if self.quiet else 0.3
        if chance < often and rng.random() < 0.2:
            near = rng.choice([0, 3, 300, 50000])
            value = int(self.position) + rng.randint(-near, near)
            self.set(side, "position_setpoint", value)
        elif chance < often:
            target = rng.choice(["target_position", "target_velocity", "target_force"])
            near = int(self.position) + rng.randint(-3000, 3000)
            value = near if target == "target_position" else rng.choice(VALUES[target])
            self.set(side, target, value if rng.random() < 0.7 else rng.choice(VALUES[target]))
            self.set(side, "controlword", 0x0F)
            self.set(side, "controlword", rng.choice([0x1F, 0x1F, 0x3F, 0x21F, 0x5F, 0x10F]))
        elif chance < often + 0.05:
            self.set(side, "controlword", rng.choice(COMMANDS))
        elif chance < often + 0.08:
            name = rng.choice(list(VALUES))
            self.set(side, name, rng.choice(VALUES[name]), rng.choice([LOCAL, CANOPEN, 1]))
        elif chance < often + 0.10:
            self.mode = rng.choice(MODES)
            self.set(side, "modes_of_operation", self.mode)
        elif chance < often + 0.14:
            for word in (0x00, 0x80, 0x06, 0x0F):
                self.set(side, "controlword", word)
        elif chance < often + 0.15:
            self.set(side, "recorder_arm", 1)
        elif chance < often + 0.16:
            names = [
                f"sdo_{bus}_{way}" for bus in ("modbus", "lcm") for way in ("receive", "transmit")
            ]
            for place, name in enumerate(names):
                self.set(side, name, 0x680 + place)

    def redirect_profile(self, side):
        """A new end of the profile and new limits, in the middle of its way."""
        rng = self.profile_rng
        self.set(side, "profile_enable", 1)
        for name in PROFILE:
            self.set(side, name, rng.choice(VALUES[name]))
        if rng.random() < 0.5:
            near = rng.choice([0, 300, 50_000, 50_000, 50_000_000])
            self.set(side, "position_setpoint", int(self.position) + rng.randint(-near, near))

    def frames(self, side):
        """Up to a few frames of every kind."""
        rng = self.rng
        rate = 0.1 if self.quiet else 0.35
        while rng.random() < rate:
            kind = rng.random()
            if kind < 0.35:
                side.receive(0x80, b"" if rng.random() < 0.97 else b"\1\2")
            elif kind < 0.65:
                word = rng.choice(COMMANDS + [0x0F] * 10)
                data = struct.pack("<HI", word, rng.getrandbits(32)) + b"\1\2"
                at = 0x200 + 0x100 * rng.randrange(4) + NODE
                side.receive(at, data[: rng.choice([3, 4, 6, 6, 8, 8, 8])])
            elif kind < 0.8:
                side.receive(0x700 + 20 + rng.randrange(4), bytes([5 if rng.random() < 0.9 else 0]))
            elif kind < 0.98:
                server = rng.choice([0x600 + NODE, 0x600 + NODE, 0x680, 0x682])
                side.receive(server, self.request())
            else:
                command = rng.choice([1, 1, 1, 2, 128, 130, 129])
                side.receive(0, bytes([command, NODE]))
        if rng.random() < 0.02:
            side.modbus(rng.choice(self.requests))
        if rng.random() < 0.004:
            side.modbus(bytes(rng.randrange(256) for _ in range(rng.randrange(1, 9))))

    def request(self):
        """A request to an SDO server."""
        rng = self.rng
        kind = rng.random()
        if kind < 0.4:
            o = rng.choice(self.recordable)
            return struct.pack("<BHBI", 0x40, o.index, o.sub, 0)
        if kind < 0.7:
            name = rng.choice(list(VALUES))
            o, value = self.objects[name], rng.choice(VALUES[name])
            command = 0x23 | (4 - SIZES[o.type]) << 2
            data = (value % (1 << 32)).to_bytes(4, "little")[: SIZES[o.type]].ljust(4, b"\0")
            return struct.pack("<BHB", command, o.index, o.sub) + data
        if kind < 0.8:
            # An upload of text; abandoned, it times out.
            return bytes.fromhex("4008100000000000")
        return bytes([rng.choice([0x60, 0x70, 0x60, 0x70, 0x05, 0x80])]) + bytes(7)

    def accidents(self, side):
        rng = self.rng
        if rng.random() < 0.003:
            side.bus(rng.choice([0, 1, 2]))
        elif rng.random() < 0.01:
            side.bus(0)
        if rng.random() < 0.003:
            side.lost(rng.choice([1, 5, 65535]))
        if rng.random() < 0.003:
            side.overrun()

    # The plant.

    def start_drive(self, side):
        rng = self.drive_rng
        self.fitted = rng.random() < 0.2
        self.drive_on_after = rng.choice([0, 3, 30])
        if self.fitted:
            for name, values in FITTED_DRIVE.items():
                self.set(side, name, rng.choice(values))
            self.drive_cycle, self.drive_late = rng.choice([(1, 0), (1, 0), (3, 0), (6, 2)])

    def report_drive(self, outputs, inputs):
        """What a drive reports that comes on some ticks after the amplifier, and ages of values."""
        inputs.drive = inputs.position_age = inputs.force_age = 0
        if not self.fitted:
            return
        rng = self.drive_rng
        self.enabled_ticks = self.enabled_ticks + 1 if outputs[2] else 0
        on = self.enabled_ticks > self.drive_on_after and rng.random() > 0.001
        fault, limit = rng.random() < 0.001, rng.random() < 0.1
        inputs.drive = 1 | on << 1 | fault << 2 | limit << 3
        # Over a bus, a position is older in each tick until the next one arrives.
        inputs.position_age = self.drive_late + self.tick_number % self.drive_cycle
        if rng.random() < 0.002:
            inputs.position_age, inputs.force_age = rng.choice([(255, 0), (0, 255), (1, 1)])

    def sense(self, outputs, inputs):
        """A crude axis: the code drives the speed, a wall presses back."""
        rng = self.rng
        code = struct.unpack("<h", outputs[:2])[0]
        if self.calm:
            self.sense_calm(code, inputs)
            return
        self.speed += 0.2 * (code / 50.0 - self.speed)
        self.position += self.speed
        if abs(self.position) > 2e9:
            self.position = 0.0
        chance = rng.random()
        if chance < 0.02:
            self.wall = self.position + rng.randint(-50, 2000)
        elif chance < 0.0205:
            self.position = rng.choice([2.0**31 - 20, -(2.0**31) + 5, 0.0])
        inputs.encoder_cnt = signed(int(self.position))
        inputs.adc_code[0] = max(0, min(255, int((self.position - self.wall) / 2)))
        # A sample at the end of the range ends a cycle.
        if rng.random() < (0.001 if self.cycles else 0.05):
            inputs.adc_code[0] = rng.choice([0, 255, rng.randrange(256)])
        inputs.adc_code[1] = rng.randrange(256)
        inputs.din = 1 if rng.random() > 0.003 else rng.choice([0, 3, 5, 7, 9, 15, 17, 31])
        # Switches at places of the axis, and an index every 300 counts.
        inputs.din |= (self.position < -900) << 2 | (self.position > 5000) << 1
        inputs.din |= (200 < self.position % 2000 < 900) << 4 | (self.position % 300 < 20) << 3
        inputs.sensor_valid = int(rng.random() >= 0.001)

    def sense_calm(self, code, inputs):
        """The same axis without accidents, its encoder perhaps reversed or dead."""
        self.speed += 0.2 * (code / 50.0 - self.speed)
        self.position += self.speed
        inputs.encoder_cnt = signed(self.encoder_sign * int(self.position))
        inputs.adc_code[0] = max(1, min(254, int((self.position - self.wall) / 2)))
        inputs.adc_code[1] = 100
        inputs.din = self.din
        inputs.sensor_valid = 1

    def step(self, side, inputs):
        """The events before one tick, and its inputs; the caller runs the tick."""
        if self.tick_number == self.scenario_end:
            self.start_scenario(side)
        self.tick_number += 1
        if self.cycles:
            if self.tick_number % 250 == 0:
                self.run_cycle(side)
            if self.cycle_rng.random() < 0.004:
                self.command(side)
                self.frames(side)
                self.accidents(side)
        elif not self.calm or self.calm_rng.random() < 0.005:
            self.command(side)
            self.frames(side)
            self.accidents(side)
        elif self.calm_rng.random() < 0.003:
            self.set(side, "modes_of_operation", self.calm_rng.choice(MODES))
        if self.mode == NATIVE_POSITION and self.profile_rng.random() < 0.1:
            self.redirect_profile(side)
        if self.mode in EXCITED_MODES and self.excite_rng.random() < 0.2:
            self.set(side, "excitation_run", int(self.excite_rng.random() < 0.9))
        self.sense(side.outputs, inputs)
        self.report_drive(side.outputs, inputs)


class CycleFuzz(Fuzz):
    """Cycles in each scenario, with programs whose phases end in the ticks that have most to do."""

    calm_share, program_share, cycle_share, short_share = 0.0, 1.0, 1.0, 1.0


class GuidedFuzz(Fuzz):
    """First motions, and cycles of any phases, which many conditions end in their middle."""

    calm_share, program_share, cycle_share, short_share = 0.5, 1.0, 1.0, 0.0
