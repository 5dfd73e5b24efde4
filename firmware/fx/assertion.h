#ifndef FIRMWARE_FX_ASSERTION_H_
#define FIRMWARE_FX_ASSERTION_H_

/* fx_assert(condition) states a condition that is true whenever the processor executes this line:
 * the domain of a function, the range of a value, or an invariant of a structure. `condition` must
 * have no side effect.
 *
 * In an image and in the programs of the host, the compiler only checks that the condition is valid
 * C, and compiles no instruction for it. The unit tests with sanitizers, the fuzzers, the random
 * masters and an image for the emulator are compiled with another file of this name, which is in
 * tests/firmware/asserted. In these programs a condition that is false ends the program.
 *
 * Do not use an assertion for bad input. A value from a bus, a sensor or the memory of the
 * parameters is checked instead, and a bad value is refused or latched as a fault. */

#include <stdbool.h>

#define fx_assert(condition) ((void)(true || (condition)))

#endif
