/* On the host an assertion that does not hold is one line of text and ends the program. */

#include <stdio.h>
#include <stdlib.h>

#include "firmware/fx/assertion.h"

_Noreturn void fx_assertion_failed(const char *text) {
  fprintf(stderr, "%s: the firmware asserts this, and it does not hold\n", text);
  abort();
}
