#include "host/axis_linux/settings_format.hpp"

#include "firmware/drive402/drive402_names.h"

namespace forceaxis::axis_linux {
namespace {

using sim::KeyFormat;
using sim::TableFormat;
using sim::format::integer;
using sim::format::optional_integer;
using sim::format::other;
using sim::format::table;

constexpr KeyFormat kObjectKeys[] = {
    integer("index", 0x1000, 0xFFFF, {}, "Index of the object, such as 0x607E."),
    integer("sub", 0, 255, 0, "Subindex of the object."),
    integer("bytes", 1, 4, {}, "Size of the object in bytes: 1, 2 or 4."),
    integer("value", -2147483647 - 1, 2147483647, {}, "Value that is written and read back."),
};
constexpr TableFormat kObject{
    "An object of the drive that is written before those of the master, such as a limit, a unit, "
    "the polarity (607Eh) or the quick stop option (605Ah).",
    kObjectKeys};

// Keys for objects that a drive lacks, or that may have another value in the drive.
#define LACKS(name, bit, key, what) \
  other("lacks_" key, "flag", "false", "The drive has no " what "."),
#define DIFFERS(name, bit, key, what)    \
  other("differs_" key, "flag", "false", \
        "The drive may keep its own value of " what ", or refuse the write."),

constexpr KeyFormat kDriveKeys[] = {
    other("interface", "text", "", "CAN interface of the drive and the load cell, such as can1."),
    integer("node_id", 1, 127, {}, "CANopen node id of the drive."),
    integer("master_node_id", 1, 127, 127, "CANopen node id of this process on the drive's bus."),
    other("mode", "velocity, torque, position", "velocity",
          "Cyclic synchronous mode of the drive: velocity (csv), torque (cst) or position (csp)."),
    integer("target_num", 1, 2147483647, {},
            "Numerator of the target in units of the drive per DAC code. Code 2048 is full speed, "
            "or rated torque. With `dac_bits` above 12 the code has a fraction, and the target is "
            "rounded once, half up."),
    integer("target_den", 1, 2147483647, 1, "Denominator of the target per DAC code."),
    integer("target_max", 1, 2147483642, {},
            "Largest magnitude of the target in units of the drive; at most 32767 for torque."),
    integer("cycle_ms", 2, 100, 2, "Period of the bus in ms, an even number: 2 ms are 3 ticks."),
    integer("rpdo_type", 0, 255, 255,
            "Transmission type of the RPDO: 1 for a target that acts at the next SYNC, 254 or 255 "
            "for a target that acts on reception."),
    integer("heartbeat_ms", 1, 65535, 50, "Period of both heartbeats in ms."),
    integer("heartbeat_timeout_ms", 1, 65535, 150,
            "Time in ms without a heartbeat after which drive and master stop."),
    integer("sdo_timeout_ms", 1, 65535, 1000,
            "Longest wait for an answer by SDO in ms; a request without an answer is repeated "
            "once."),
    integer(
        "wait_ms", 1, 65535, 5000,
        "Longest wait in ms for the boot-up message of the drive, for its first TPDO, and until "
        "it is on."),
    integer(
        "quick_stop_ms", 0, 65535, 1000,
        "Longest time in ms for which a quick stop is commanded before the voltage is disabled. "
        "It ends when the drive leaves the quick stop by itself."),
    integer("abort_option", -32768, 32767, 3,
            "What the drive does without the master (6007h); 3 is a quick stop."),
    DRIVE402_OBJECTS(LACKS) DRIVE402_VALUES(DIFFERS) table("object", kObject, true),
};
constexpr TableFormat kDrive{"The CiA 402 drive.", kDriveKeys};

constexpr KeyFormat kLoadCellKeys[] = {
    integer("identifier", 1, 2047, {}, "Identifier of the CAN frame with the force."),
    integer("byte", 0, 7, 0, "Number of the lowest byte of the force in the frame."),
    integer("bytes", 1, 4, {}, "Number of bytes of the force, the lowest byte first."),
    integer("shift", 0, 31, 0,
            "Number of the lowest bits that are cut off, so that the ADC code has 16 bits."),
    other("signed", "flag", "true", "The force is a signed integer, and code 32768 is 0."),
};
constexpr TableFormat kLoadCell{"The load cell, on the bus of the drive.", kLoadCellKeys};

constexpr KeyFormat kIioKeys[] = {
    other(
        "device", "text", "",
        "Folder of the device in sysfs, such as /sys/bus/iio/devices/iio:device0. Its channel and "
        "its buffer have to be enabled."),
    other("buffer", "text", "/dev/ and the name of the folder",
          "Character device of the buffer, such as /dev/iio:device0."),
    other("channel", "text", "", "Name of the channel, such as voltage0."),
    optional_integer(
        "shift", 0, 31, "the upper 16 bits are used",
        "Number of the lowest bits of a value that are cut off. Code 32768 is 0 if the "
        "channel is signed, otherwise code 0 is 0."),
};
constexpr TableFormat kIio{
    "A converter of this machine with a driver of the kernel for industrial I/O, such as an AD7190 "
    "at SPI, in place of [load_cell].",
    kIioKeys};

constexpr KeyFormat kRealTimeKeys[] = {
    integer("priority", 0, 99, 80,
            "Priority of the ticks (SCHED_FIFO). 0: ordinary scheduling, for tests."),
    integer("cpu", -1, 1023, -1, "Number of the CPU of the ticks; -1: any CPU."),
    integer("late_ticks_max", 1, 1000, 3,
            "Largest lateness of a tick in ticks. A later tick disables the axis with a fault."),
};
constexpr TableFormat kRealTime{"The ticks of the process.", kRealTimeKeys};

constexpr KeyFormat kKeys[] = {
    other("supervisor", "text", "", "CAN interface on which the axis is a CANopen node."),
    integer("node_id", 1, 127, 1, "CANopen node id of the axis."),
    other("store", "text", "nothing is stored", "File of the stored parameters."),
    other("archive", "text", "no incident is kept", "File of the archive of incidents."),
    table("drive", kDrive),
    table("load_cell", kLoadCell),
    table("iio", kIio),
    table("real_time", kRealTime),
};

}  // namespace

constexpr TableFormat kSettingsFormat{"The settings of axis_linux.", kKeys};

}  // namespace forceaxis::axis_linux
