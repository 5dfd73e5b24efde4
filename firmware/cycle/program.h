#ifndef FIRMWARE_CYCLE_PROGRAM_H_
#define FIRMWARE_CYCLE_PROGRAM_H_

/* A cycle program: a record of phases, their conditions and limits, and evaluation elements.
 *
 * The record consists of the header, the phases, the evaluation elements, the points and a CRC-32
 * of all these bytes, in this order. There are no unused bytes between them, and the lowest byte of
 * each number is first. The structures below are the layout of the record. Positions and speeds are
 * in user units of the drive (608Fh, 6091h, 6092h), travels in encoder counts, press forces in per
 * mille of rated_force, other forces in 1/256 count of measured force, times in ticks of 1/1500 s.
 *
 * The depth is the travel from travel 0 minus the deflection of the press at the present force. In
 * a cycle program without a curve of the compliance the deflection is 0. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/cycle/element.h"
#include "firmware/cycle/table.h"

enum {
  CYCLE_PROGRAM_BYTES_MAX = 4096,
  CYCLE_PHASES_MAX = 16,
  CYCLE_CONDITIONS = 4,
  CYCLE_ELEMENTS_MAX = 16,
  CYCLE_COMPLIANCE_MAX = 16,
  CYCLE_VERSION = 2,
  /* CYCLE_END instead of the number of the next phase means that the cycle ends. */
  CYCLE_END = 255
};
#define CYCLE_MAGIC UINT32_C(0x59435846) /* "FXCY" */

/* Definition of travel 0.
 *   TOUCH     travel 0 is at the first contact of the cycle
 *   FORCE     travel 0 is at the first sample whose force is at least zero_level; if zero_level is
 *             negative, at the first sample whose force is at most zero_level
 *   POSITION  travel 0 is at the position zero_level in user units; the axis must be homed
 *
 * Until travel 0 of TOUCH or FORCE is found, travel and depth are measured from the start of the
 * cycle. The deflection of the press at travel 0 is taken into account, so that the depth at travel
 * 0 is 0. */
enum { CYCLE_ZERO_TOUCH = 0, CYCLE_ZERO_FORCE = 1, CYCLE_ZERO_POSITION = 2, CYCLE_ZEROS = 3 };

/* What a phase does.
 *   MOVE           the axis moves to a position
 *   MOVE_BY        the axis moves by a distance from the position that was demanded when the phase
 *                  began
 *   MOVE_TO_DEPTH  the axis moves to the position that has a given depth if the press does not
 *                  deflect
 *   APPROACH       the axis moves by a distance, as in MOVE_BY, and stops at contact
 *   PRESS          the axis presses with a force; without contact it approaches as in mode 4
 *   WAIT           the axis brakes to standstill and stays at its position
 *   FOLLOW         the axis presses as in PRESS; the target is the force of a table (table.h), in
 *                  1/256 per mille of rated_force, over the time or the travel since the begin of
 *                  the phase
 *   TARE           the axis waits, and the offset of the force is measured (see below)
 *   OUTPUT         the axis waits; the target of the phase is reached in its first tick
 *
 * A phase of any action switches its digital outputs when the phase begins. At the end of the cycle
 * all outputs except those of outputs_keep go off, whatever has ended the cycle. An output of
 * outputs_keep keeps its state until a cycle starts whose program does not keep this output, or
 * until a cycle program is selected.
 *
 * TARE measures the mean of the measured force over `target` ticks, rounded half up. The
 * measurement starts again when the encoder has moved by more than CYCLE_TARE_JITTER_CNT, and after
 * a sample that is not valid (sample.h). The mean becomes the offset of the cycle program until the
 * end of the cycle. The offset is subtracted from the force that conditions, zero_level and
 * evaluation elements use. It is added to the target of PRESS and FOLLOW before this target is
 * bounded. force_max of a phase limits the measured force itself, so no offset weakens this limit.
 * The tare fails if the axis is in contact, if the axis does not stand still before time_max, if
 * the sum of the mean and force_tare is beyond tare_band, or if tare_band is 0. A tare that fails
 * acts like an exceeded limit. */
enum {
  CYCLE_TARE_TICKS_MAX = 15000, /* longest tare measurement: 10 s */
  CYCLE_TARE_JITTER_CNT = 2,
  CYCLE_OUTPUTS_ALL = 15 /* set of all digital outputs, 1 to 4, as bits */
};
enum {
  CYCLE_MOVE = 0,
  CYCLE_MOVE_BY = 1,
  CYCLE_MOVE_TO_DEPTH = 2,
  CYCLE_APPROACH = 3,
  CYCLE_PRESS = 4,
  CYCLE_WAIT = 5,
  CYCLE_FOLLOW = 6,
  CYCLE_TARE = 7,
  CYCLE_OUTPUT = 8,
  CYCLE_ACTIONS = 9
};

/* Kinds of conditions, and when a condition is met. `level` is in the unit of the compared value.
 *   REACHED       the target of the phase is reached. In FOLLOW, the time or the travel must also
 *                 be at or beyond the last point of the table. In TARE, the offset must be
 *                 measured. In WAIT, the condition is never met
 *   TIME          the phase has lasted for `level` ticks
 *   FORCE_ABOVE   the measured force minus the offset of TARE is at least `level`; FORCE_BELOW: it
 *                 is at most `level`
 *   TRAVEL_ABOVE  the travel since the phase began is at least `level`, in either direction
 *   DEPTH_ABOVE   travel 0 was found, and the depth is at least `level`; DEPTH_BELOW: travel 0 was
 *                 found, and the depth is at most `level`
 *   CONTACT, LOST the axis is in contact; LOST: it is not in contact
 *   INPUT_ON, OFF all digital inputs in the mask `level` are on; INPUT_OFF: all are off
 *   STIFFNESS_ABOVE  the change of the force divided by the change of the travel, over the last
 *                 complete section of stiffness_travel in this phase, is at least `level`. The unit
 *                 of `level` is 1/65536 of 1/256 count of force per encoder count.
 *                 STIFFNESS_BELOW: it is at most `level` */
typedef enum {
  CYCLE_NEVER = 0,
  CYCLE_REACHED = 1,
  CYCLE_TIME = 2,
  CYCLE_FORCE_ABOVE = 3,
  CYCLE_FORCE_BELOW = 4,
  CYCLE_TRAVEL_ABOVE = 5,
  CYCLE_DEPTH_ABOVE = 6,
  CYCLE_DEPTH_BELOW = 7,
  CYCLE_CONTACT = 8,
  CYCLE_LOST = 9,
  CYCLE_INPUT_ON = 10,
  CYCLE_INPUT_OFF = 11,
  CYCLE_STIFFNESS_ABOVE = 12,
  CYCLE_STIFFNESS_BELOW = 13
} cycle_when_t;
enum { CYCLE_CONDITION_KINDS = CYCLE_STIFFNESS_BELOW + 1 };

typedef struct {
  uint8_t when;
  /* number of the next phase, or CYCLE_END: the cycle ends as the cycle program intends */
  uint8_t next;
  /* largest number of times in a cycle that this condition may end its phase; 0: any number of
   * times */
  uint16_t count;
  int32_t level;
} cycle_condition_t;

typedef struct {
  uint8_t action;
  uint8_t reaction; /* number of the phase that follows if a limit is exceeded, or CYCLE_END: the
                     * cycle ends */
  int16_t force;    /* action PRESS: target of the force in per mille of rated_force */
  /* actions PRESS and FOLLOW: rate of change of the demanded force, in per mille of rated_force per
   * second, above 0 */
  uint32_t slope;
  /* actions that move the axis: target position or distance, in user units; action TARE: number
   * of ticks */
  int32_t target;
  uint32_t speed; /* actions that move the axis: speed in user units per second, above 0 */
  /* Limits of the phase, each above 0: magnitude of the measured force, travel since the phase
   * began, duration of the phase. */
  uint32_t force_max_q8;
  uint32_t travel_max;
  uint32_t time_max;
  /* Travel, in encoder counts, over which STIFFNESS_ABOVE and STIFFNESS_BELOW measure the
   * stiffness. It is above 0 if the phase has one of these conditions, and 0 otherwise. */
  uint16_t stiffness_travel;
  /* action FOLLOW: index of the first point of the table of this phase, among all points of the
   * cycle program */
  uint16_t first;
  uint8_t points;      /* action FOLLOW: number of points of the table */
  uint8_t over_travel; /* action FOLLOW: 1 if x of the table is the travel, 0 if x is the time in
                        * ticks */
  uint8_t outputs_on;  /* digital outputs that are switched on when the phase begins */
  uint8_t outputs_off; /* digital outputs that are switched off when the phase begins */
  cycle_condition_t conditions[CYCLE_CONDITIONS];
} cycle_phase_t;

typedef struct {
  uint32_t magic;
  uint16_t version;
  uint16_t size; /* size of the record in bytes, including the CRC */
  uint8_t phases;
  uint8_t elements;
  uint16_t points;
  /* CRC of the filter bank for which the cycle program was made; 0: the program permits every bank
   */
  uint32_t bank_crc;
  uint32_t number;  /* number that the user has given to the cycle program */
  uint8_t name[12]; /* name of the program as text, filled with zeros */
  /* force or position that defines travel 0 (see `zero`); 0 for CYCLE_ZERO_TOUCH, not 0 for
   * CYCLE_ZERO_FORCE */
  int32_t zero_level;
  uint8_t zero; /* definition of travel 0: by contact, force or position (CYCLE_ZERO_) */
  /* Number of points of the curve of the compliance, at most CYCLE_COMPLIANCE_MAX. They are the
   * first points of the program. Their x is the force in 1/256 count, and their y is the deflection
   * of the press in encoder counts. If the number is 0, the press does not deflect. */
  uint8_t compliance;
  uint8_t outputs_keep; /* digital outputs that keep their state at the end of the cycle */
  uint8_t reserved;     /* 0 */
} cycle_header_t;

/* Reasons why a cycle program is refused. The result of a check also has the number of the wrong
 * phase or evaluation element. */
enum {
  CYCLE_ACCEPTED = 0,
  /* refusal: the record of the cycle program is too short, or does not begin with CYCLE_MAGIC */
  CYCLE_NO_PROGRAM = 1,
  /* refusal: the cycle program has a version of its layout that is not supported */
  CYCLE_OTHER_VERSION = 2,
  /* refusal: the size of the cycle program does not match its numbers of phases, elements and
   * points, or one of these is too large */
  CYCLE_WRONG_SIZE = 3,
  CYCLE_WRONG_CRC = 4,
  CYCLE_WRONG_PHASE = 5,
  CYCLE_WRONG_ELEMENT = 6,
  CYCLE_BUSY = 7,    /* a cycle is running */
  CYCLE_NO_ROOM = 8, /* refusal: the library has no room for the cycle program */
  /* refusal: the cycle program has the number 0, which is not permitted in the library */
  CYCLE_NO_NUMBER = 9,
  CYCLE_WRONG_ZERO = 10,
  /* refusal: compliance, outputs_keep or the reserved byte of the cycle program is wrong */
  CYCLE_WRONG_HEADER = 11,
  CYCLE_LOCKED = 12, /* the axis accepts no cycle program now */
  CYCLE_REASONS = 13
};
typedef struct {
  uint8_t reason;
  uint8_t number;
} cycle_check_t;

/* Checks a record of `size` bytes, which begins at a multiple of 4. A record in which any single
 * bit is wrong is refused. The check needs some 10 instructions for each byte. */
cycle_check_t cycle_program_check(const void *record, uint32_t size);

/* cycle_phases(), cycle_elements() and cycle_points() return the phases, the evaluation elements
 * and the points of a cycle program that was checked. */
static inline const cycle_phase_t *cycle_phases(const cycle_header_t *program) {
  return (const cycle_phase_t *)(const void *)(program + 1);
}
static inline const cycle_element_t *cycle_elements(const cycle_header_t *program) {
  return (const cycle_element_t *)(const void *)(cycle_phases(program) + program->phases);
}
static inline const cycle_point_t *cycle_points(const cycle_header_t *program) {
  return (const cycle_point_t *)(const void *)(cycle_elements(program) + program->elements);
}

/* Returns the set of the evaluated phases, as bits. The verdict on the part depends on the samples
 * of force and position in these phases. A phase is evaluated if an evaluation element names it; if
 * its action is APPROACH, PRESS, FOLLOW or TARE; or if it has a condition on the force, the contact
 * or the stiffness. A phase with a condition on the depth is evaluated if the press has a
 * compliance. Until travel 0 of TOUCH or FORCE is found, every phase is evaluated. */
uint16_t cycle_program_judged(const cycle_header_t *program);

/* Forces that the force sensor must be able to measure for a cycle program, in 1/256 count of
 * measured force. */
typedef struct {
  int32_t force_max_q8; /* largest force_max of all phases */
  /* largest force of the program: the largest of 0, zero_level and the levels of FORCE_ABOVE */
  int32_t most_q8;
  /* smallest force of the program: the smallest of 0, zero_level and the levels of FORCE_BELOW */
  int32_t least_q8;
} cycle_reach_t;
cycle_reach_t cycle_program_reach(const cycle_header_t *program);

/* Returns the CRC at the end of the record of a cycle program. */
uint32_t cycle_program_crc(const cycle_header_t *program);

#endif
