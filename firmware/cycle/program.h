#ifndef FIRMWARE_CYCLE_PROGRAM_H_
#define FIRMWARE_CYCLE_PROGRAM_H_

/* The program of a cycle: a record of phases, their conditions and limits, and evaluation elements.
 *
 * The record consists of the header, the phases, the elements, the points and a CRC-32 over all
 * bytes before it, in this order, without gaps and with the lowest byte of a number first. The
 * structures below are its layout. Positions and speeds are in user units of the drive (608Fh,
 * 6091h, 6092h), travels in encoder counts, press forces in per mille of rated_force, other forces
 * in 1/256 count of measured force, times in ticks of 1/1500 s.
 *
 * The depth is the travel from travel 0, less the deflection of the press at the present force. The
 * deflection is 0 in a program without a curve of compliance. */

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
  CYCLE_END = 255 /* number in place of a phase: the cycle ends */
};
#define CYCLE_MAGIC UINT32_C(0x59435846) /* "FXCY" */

/* Definition of travel 0.
 *   TOUCH     at the first contact of the cycle
 *   FORCE     at the first sample with a force of at least zero_level (at most, if it is negative)
 *   POSITION  at the position zero_level in user units; the axis has to be homed
 *
 * Until TOUCH or FORCE is found, travel and depth count from the start of the cycle. The deflection
 * at travel 0 belongs to the place of travel 0, so that the depth is 0 there. */
enum { CYCLE_ZERO_TOUCH = 0, CYCLE_ZERO_FORCE = 1, CYCLE_ZERO_POSITION = 2, CYCLE_ZEROS = 3 };

/* What a phase does.
 *   MOVE           moves to a position
 *   MOVE_BY        moves by a distance from the demand position at its start
 *   MOVE_TO_DEPTH  moves to the place whose depth is the distance if the press deflects by 0
 *   APPROACH       moves by a distance, as MOVE_BY does, and stops at contact
 *   PRESS          presses with a force; out of contact it approaches as mode 4 does
 *   WAIT           brakes to standstill and stays
 *   FOLLOW         presses as PRESS does; the target is the force of a table (table.h), in 1/256
 *                  per mille of rated_force, over the time or the travel since the phase began
 *   TARE           waits, and measures the offset of the force (see below)
 *   OUTPUT         waits; the phase is reached in its first tick
 *
 * A phase of any action switches its outputs when it begins. At the end of the cycle, however it
 * ends, all outputs but those of outputs_keep go off. A kept output stays as it is up to a cycle of
 * a program that does not keep it, or up to the selection of a program.
 *
 * TARE measures the mean of the measured force over `target` ticks, rounded half up. The
 * measurement begins anew when the encoder has moved by more than CYCLE_TARE_JITTER_CNT, and after
 * a sample that is not valid (sample.h). The mean becomes the offset of the program up to the end
 * of the cycle: it is subtracted from the force in conditions, in zero_level and in the samples of
 * the elements, and it is added to the target of PRESS and FOLLOW before that target is bounded.
 * force_max of a phase limits the measured force itself, so no offset weakens this limit. The tare
 * fails, as a limit that is exceeded does, in contact, if the axis does not stand still up to
 * time_max, or if the sum of the mean and force_tare is beyond tare_band, or tare_band is 0. */
enum {
  CYCLE_TARE_TICKS_MAX = 15000, /* 10 s */
  CYCLE_TARE_JITTER_CNT = 2,
  CYCLE_OUTPUTS_ALL = 15 /* outputs 1 to 4, as bits */
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

/* When a condition is met. `level` is in the unit of the quantity.
 *   REACHED       the target of the phase is reached; FOLLOW: also, the time or the travel is at or
 *                 beyond the last point of the table; TARE: the offset is measured; WAIT: never
 *   TIME          the phase lasts for `level` ticks
 *   FORCE_ABOVE   the measured force less the offset of TARE is at least `level`; BELOW: at most
 *   TRAVEL_ABOVE  the travel since the phase began is at least `level`, in either direction
 *   DEPTH_ABOVE   travel 0 is found, and the depth is at least `level`; BELOW: at most
 *   CONTACT, LOST the axis is in contact, or not
 *   INPUT_ON, OFF the digital inputs of the mask `level` are all on, or all off
 *   STIFFNESS_ABOVE  the change of the force over the last complete section of stiffness_travel in
 *                 this phase, divided by the change of the travel, is at least `level`, in 1/65536
 *                 of 1/256 count of force per encoder count; BELOW: at most */
enum {
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
  CYCLE_STIFFNESS_BELOW = 13,
  CYCLE_CONDITION_KINDS = 14
};

typedef struct {
  uint8_t when;
  uint8_t next;   /* number of the next phase, or CYCLE_END: the cycle ends as intended */
  uint16_t count; /* largest number of times in a cycle that the condition may end the phase; 0: not
                   * limited */
  int32_t level;
} cycle_condition_t;

typedef struct {
  uint8_t action;
  uint8_t reaction; /* number of the phase that follows if a limit is exceeded, or CYCLE_END: the
                     * cycle ends */
  int16_t force;    /* PRESS: target in per mille of rated_force */
  uint32_t slope;   /* PRESS, FOLLOW: change of the demanded force in per mille per second, > 0 */
  int32_t target;   /* actions that move the axis: position or distance in user units; TARE: number
                     * of ticks */
  uint32_t speed;   /* actions that move the axis: speed in user units per second, > 0 */
  /* Limits, each > 0: magnitude of the measured force, travel since the phase began, duration. */
  uint32_t force_max_q8;
  uint32_t travel_max;
  uint32_t time_max;
  /* Travel of one section for STIFFNESS_ABOVE and BELOW, > 0 with such a condition and else 0. */
  uint16_t stiffness_travel;
  uint16_t first;      /* action FOLLOW: index, among the program's points, of the first point of
                        * the table that the phase follows */
  uint8_t points;      /* FOLLOW: number of points */
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
  uint32_t bank_crc;  /* CRC of the bank for which the program was made; 0: any bank */
  uint32_t number;    /* number of the program, which the user has chosen */
  uint8_t name[12];   /* text, filled up with 0 */
  int32_t zero_level; /* 0 with CYCLE_ZERO_TOUCH, not 0 with CYCLE_ZERO_FORCE */
  uint8_t zero;       /* kind of definition of travel 0, CYCLE_ZERO_ */
  /* Number of points of the curve of compliance, at most CYCLE_COMPLIANCE_MAX, which are the first
   * ones of the program's points: deflection of the press in encoder counts over the force in 1/256
   * count. 0: no deflection. */
  uint8_t compliance;
  uint8_t outputs_keep; /* digital outputs that keep their state at the end of the cycle */
  uint8_t reserved;     /* 0 */
} cycle_header_t;

/* Reasons why a program is refused, and the number of the phase or evaluation element that is
 * wrong. */
enum {
  CYCLE_ACCEPTED = 0,
  CYCLE_NO_PROGRAM = 1,    /* too short, or another magic */
  CYCLE_OTHER_VERSION = 2, /* another layout */
  CYCLE_WRONG_SIZE = 3,    /* the size does not match the numbers of phases, elements and points, or
                            * one of these is too large */
  CYCLE_WRONG_CRC = 4,
  CYCLE_WRONG_PHASE = 5,
  CYCLE_WRONG_ELEMENT = 6,
  CYCLE_BUSY = 7,      /* a cycle runs */
  CYCLE_NO_ROOM = 8,   /* the library is full */
  CYCLE_NO_NUMBER = 9, /* a program of the library has another number than 0 */
  CYCLE_WRONG_ZERO = 10,
  CYCLE_WRONG_HEADER = 11, /* the header is wrong: compliance, outputs_keep or the reserved byte */
  CYCLE_LOCKED = 12,       /* the axis accepts no program */
  CYCLE_REASONS = 13
};
typedef struct {
  uint8_t reason;
  uint8_t number;
} cycle_check_t;

/* Checks a record of `size` bytes, which begins at a multiple of 4. A record with any flipped bit
 * is refused. Some 10 instructions for each byte. */
cycle_check_t cycle_program_check(const void *record, uint32_t size);

/* Return the phases, evaluation elements and points of a program that was checked. */
static inline const cycle_phase_t *cycle_phases(const cycle_header_t *program) {
  return (const cycle_phase_t *)(const void *)(program + 1);
}
static inline const cycle_element_t *cycle_elements(const cycle_header_t *program) {
  return (const cycle_element_t *)(const void *)(cycle_phases(program) + program->phases);
}
static inline const cycle_point_t *cycle_points(const cycle_header_t *program) {
  return (const cycle_point_t *)(const void *)(cycle_elements(program) + program->elements);
}

/* Returns the set of the evaluated phases, as bits: the verdict on the part depends on their
 * samples of force and position. These are the phases that an evaluation element names, the phases
 * approach, press, follow and tare, and the phases with a condition of force, contact or stiffness,
 * or of depth if the press has a compliance. While travel 0 of touch or force is not found, every
 * phase is evaluated. */
uint16_t cycle_program_judged(const cycle_header_t *program);

/* Forces that the sensor has to be able to show, in 1/256 count of measured force. */
typedef struct {
  int32_t force_max_q8; /* largest force_max */
  int32_t most_q8;      /* largest force: the largest of 0, zero_level and the levels of
                         * FORCE_ABOVE */
  int32_t least_q8;     /* smallest force: the smallest of 0, zero_level and the levels of
                         * FORCE_BELOW */
} cycle_reach_t;
cycle_reach_t cycle_program_reach(const cycle_header_t *program);

/* Returns the CRC at the end of a record. */
uint32_t cycle_program_crc(const cycle_header_t *program);

#endif
