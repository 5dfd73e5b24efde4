#include "host/run/cycle_conditions.hpp"
#include "host/run/cycle_file.hpp"

namespace forceaxis::host {
namespace {

using sim::KeyFormat;
using sim::TableFormat;
using sim::format::integer;
using sim::format::needed;
using sim::format::numbers;
using sim::format::optional;
using sim::format::other;
using sim::format::ranged;
using sim::format::table;
using D = sim::Dimension;
using S = sim::Sign;

constexpr double kLongest_s = 3600.0;

constexpr KeyFormat kEndKeys[] = {
    other("when", kCycleConditionNames.data(), "", "What ends the phase."),
    other("value", "number", "none",
          "Value of the quantity: s for time, N for a force, m for a travel, N/m for a stiffness. "
          "force: the measured force less the offset of tare. travel counts from the start of the "
          "phase in either direction. depth: travel from travel 0 (the key zero), less the "
          "deflection of the press. stiffness: change of the force divided by the change of the "
          "travel, over the "
          "last complete section of stiffness_travel."),
    other("inputs", "list of inputs", "none",
          "Inputs for input_on and input_off, which must all be on, or off: enable, limit_pos, "
          "limit_neg, index, home."),
    other("next", "phase or end", "", "The phase that follows; `end`: the cycle ends as intended."),
    integer("count", 0, 65535, 0,
            "Largest number of times in a cycle that this condition is taken; 0: any number."),
};
constexpr TableFormat kEnd{
    "A condition that ends the phase. Up to 4 are checked in each tick, in the order of the file, "
    "after the limits.",
    kEndKeys};

constexpr KeyFormat kPhaseKeys[] = {
    other("name", "identifier", "", "Name of the phase."),
    other("do", "move, move_by, move_to_depth, approach, press, wait, follow, tare, output", "",
          "move: to a position. move_by: by a distance from the start of the phase. move_to_depth: "
          "to a distance from travel 0, the first contact unless zero says otherwise. approach: by "
          "a distance, and stop at "
          "contact. press: with a force; out of contact the axis approaches. wait: stay. follow: "
          "press with the force of a table. tare: stay, and measure the offset of the force. "
          "output: stay, and switch outputs; the phase is reached at once."),
    optional(
        "position", D::length, S::any, "none",
        "Position of a move, from the zero of the homing (position_actual of the axis). The axis "
        "has to be homed."),
    optional("distance", D::length, S::any, "none",
             "Distance of move_by, move_to_depth and approach, positive towards the workpiece. "
             "The place of move_to_depth has this depth without a force on the press."),
    optional("speed", D::velocity, S::positive, "none", "Speed of the motion."),
    optional("force", D::force, S::not_zero, "none", "Force of press."),
    optional("slope", D::force_rate, S::positive, "none",
             "Rate at which the demanded force of press changes, from the force at its start. For "
             "follow the largest rate; a table over time may not be steeper."),
    other("over", "time, travel", "time",
          "x of the table of follow: time or travel since the phase began, the travel positive "
          "towards the workpiece."),
    numbers("table_x", D::ratio, S::any, "none",
            "x of the points of the table of follow, 2 to 255, in s or m. Between two points the "
            "force is on a straight line; before the first point it is the first force, after the "
            "last point the last one."),
    numbers("table_force", D::force, S::any, "none", "Forces of the points of the table."),
    ranged("tare_time", D::time, 1e-3, 10.0, "none",
           "Time over which tare takes the mean of the force, from standstill on."),
    other("outputs_on", "list of outputs", "none",
          "Outputs that are switched on when the phase begins, of any action: output_1, output_2, "
          "output_3, output_4."),
    other("outputs_off", "list of outputs", "none", "Outputs that are switched off."),
    needed("force_max", D::force, S::positive,
           "Limit of the magnitude of the measured force in this phase."),
    needed("travel_max", D::length, S::positive,
           "Limit of the travel since the start of the phase, in either direction."),
    ranged("time_max", D::time, 1e-3, kLongest_s, "", "Limit of the duration of the phase."),
    optional("stiffness_travel", D::length, S::positive, "none",
             "Travel of one section over which stiffness_above and stiffness_below measure, needed "
             "with them."),
    other("on_limit", "phase or end", "end",
          "The phase that follows when a limit is exceeded; the part is then not good. A second "
          "limit ends the cycle."),
    table("end", kEnd, true),
};
constexpr TableFormat kPhase{
    "A phase of the cycle, at most 16. The cycle begins with the first "
    "one.",
    kPhaseKeys};

constexpr KeyFormat kElementKeys[] = {
    other("name", "identifier", "", "Name of the element."),
    other("kind", "peak, valley, at, difference, work, last, window, envelope", "",
          "peak, valley: largest and smallest force. at: the force at an x, or x at a force. "
          "difference: the value of `at` at level_2 less that at level. work: the sum of force "
          "times the change of x. last: the last force. window: the curve passes a window. "
          "envelope: smallest distance of the force from a curve below and a curve above."),
    other("phases", "list of phases", "", "The phases whose samples count."),
    other("over", "travel, time", "travel",
          "x of the curve: travel from travel 0 (the key zero), or time since the first sample of "
          "the element."),
    other("from", "number", "the smallest x", "Begin of the range of x, in m or s."),
    other("to", "number", "the largest x", "End of the range of x."),
    other("least", "number", "no bound", "Smallest good value: N, m, s, N m or N s."),
    other("most", "number", "no bound", "Largest good value."),
    other("of", "x, force", "x", "Quantity that crosses the level of at and difference."),
    other("level", "number", "none", "Level of at and difference: m or s of x, N of force."),
    other("level_2", "number", "none", "Second level of difference."),
    other("direction", "rising, falling, either", "rising",
          "Direction of the crossing. A line that ends on the level from below crosses it rising; "
          "one that begins on it and ends below crosses it falling."),
    integer("ordinal", 1, 255, 1, "Number of the crossing that counts."),
    other("enters", "list of sides", "none",
          "Sides through which the curve may enter the window: left, right, bottom, top. A corner "
          "belongs to the left or right side."),
    other("leaves", "list of sides", "the curve ends in the window",
          "Sides through which the curve may leave the window."),
    numbers("lower_x", D::ratio, S::any, "none", "x of the points of the lower curve, in m or s."),
    numbers("lower_force", D::force, S::any, "none", "Forces of the points of the lower curve."),
    numbers("upper_x", D::ratio, S::any, "none", "x of the points of the upper curve."),
    numbers("upper_force", D::force, S::any, "none", "Forces of the points of the upper curve."),
};
constexpr TableFormat kElement{
    "An evaluation element, at most 16: a figure of the curve of force over x in some phases. The "
    "part is good if the cycle ends as intended and each element is within its bounds. A window "
    "needs all of from, to, least and most, in the units of x and of the force.",
    kElementKeys};

constexpr KeyFormat kCycleKeys[] = {
    other("title", "text", "", "Title of the program."),
    other("name", "text", "no name", "Name in the record of the program, at most 12 bytes."),
    integer("number", 0, 0x7FFFFFFF, 0, "Number of the program, for the user."),
    other(
        "bank_crc", "text", "any bank",
        "CRC of the bank that the program was made for, such as \"1A2B3C4D\": no cycle starts with "
        "another bank."),
    other("zero", "touch, force, position", "touch",
          "Where travel 0 is. touch: at the first contact of the cycle. force: where the measured "
          "force first reaches zero_force. position: at zero_position."),
    optional("zero_force", D::force, S::not_zero, "none", "Force at travel 0."),
    optional("zero_position", D::length, S::any, "none",
             "Position of travel 0, in the coordinates of the encoder. The axis has to be homed."),
    other("keep_outputs", "list of outputs", "none",
          "Outputs that stay as they are at the end of the cycle, however it ends. All others go "
          "off."),
    numbers("compliance_force", D::force, S::any, "none",
            "Forces of the points of the compliance of the press, 2 to 16."),
    numbers("compliance_deflection", D::length, S::any, "none",
            "Deflection of the press at each of these forces. It is subtracted from the travel of "
            "elements, of depth_above and of depth_below."),
    table("phase", kPhase, true),
    table("element", kElement, true),
};

}  // namespace

constexpr TableFormat kCycleFormat{
    "A cycle: phases that follow each other, and what makes a part good.", kCycleKeys};

}  // namespace forceaxis::host
