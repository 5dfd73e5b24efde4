/* On an emulated chip an assertion that does not hold is one line of text and ends the emulator. */

#include "firmware/fx/assertion.h"
#include "firmware/port/emulated/semihosting.h"

enum { SYS_WRITE0 = 4 }; /* writes a text that a 0 ends to the console of the host */

_Noreturn void fx_assertion_failed(const char *text) {
  (void)semihosting_call(SYS_WRITE0, text);
  (void)semihosting_call(SYS_WRITE0, ": the firmware asserts this, and it does not hold\n");
  semihosting_fail();
}
