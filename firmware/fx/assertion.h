#ifndef FIRMWARE_FX_ASSERTION_H_
#define FIRMWARE_FX_ASSERTION_H_

/* fx_assert(condition) states what holds whenever the processor comes to this line: the domain of a
 * function, the range of a value, or an invariant of a structure. `condition` has no side effect.
 *
 * In an image and in the programs of the host the compiler checks the condition for errors and
 * makes no instruction of it. The unit tests with sanitizers, the fuzzers, the random masters and
 * an image for the emulator are compiled with another file of this name, in
 * tests/firmware/asserted. There a condition that does not hold ends the program.
 *
 * Bad input is no case for an assertion: a value from a bus, a sensor or the memory of parameters
 * is checked, and refused or latched as a fault. */

#include <stdbool.h>

#define fx_assert(condition) ((void)(true || (condition)))

#endif
