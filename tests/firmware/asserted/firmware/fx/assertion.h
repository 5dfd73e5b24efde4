#ifndef FIRMWARE_FX_ASSERTION_H_
#define FIRMWARE_FX_ASSERTION_H_

/* fx_assert() of tests: the file of this name in firmware/fx says what it states. The folder
 * tests/firmware/asserted comes before the root of the project in the include path of a build whose
 * assertions run. */

#include <stdbool.h>

/* Ends the program with this text, which says where which condition does not hold. */
#ifdef __cplusplus
extern "C" [[noreturn]] void fx_assertion_failed(const char *text);
#else
_Noreturn void fx_assertion_failed(const char *text);
#endif

#define FX_ASSERTION_TEXT(file, line, condition) file ":" #line ": " condition
#define FX_ASSERTION_LINE(file, line, condition) FX_ASSERTION_TEXT(file, line, condition)
#define fx_assert(condition) \
  ((condition) ? (void)0 : fx_assertion_failed(FX_ASSERTION_LINE(__FILE__, __LINE__, #condition)))

#endif
