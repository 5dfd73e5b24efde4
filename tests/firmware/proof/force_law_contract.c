/* The contract of the force law, for every legal bank and every input: no sum overflows, and what
 * the law keeps stays within its range. test_force_law_contract.py has Frama-C prove it of the very
 * source, which is included below; its loops carry their invariants. */

#include <stdbool.h>
#include <stdint.h>

#include "firmware/core/force_law.h"
#include "firmware/fx/fx.h"

/*@ predicate within(integer x, integer most) = -most <= x <= most;
    // A coefficient (Q26) or a signal (Q16).
    predicate bounded(integer x) = within(x, 1073741824);
    predicate legal_state(force_section_t *s) =
        bounded(s->x[0]) && bounded(s->x[1]) && bounded(s->y[0]) && bounded(s->y[1]) &&
        s->remainder_q26 < 67108864;
    predicate legal_section(int32_t *c) =
        bounded(c[0]) && bounded(c[1]) && bounded(c[2]) && bounded(c[3]) && bounded(c[4]);
    predicate legal_bank(force_bank_t *b) =
        b->sections <= 3 && b->integral_q26 <= 67108864 &&
        (\forall integer i; 0 <= i < 3 ==> legal_section(&b->coefficient_q26[i][0]));
    predicate legal_sections(force_law_t *l) =
        \forall integer i; 0 <= i < 3 ==> legal_state(&l->sections[i]);
    predicate legal_integral(force_law_t *l) =
        -134283264 <= l->integral_q16 <= 134217728 && l->integral_remainder_q26 < 67108864;
*/

/*@ assigns \nothing; ensures bounded(a) && bounded(b) ==> within(\result, 1152921504606846976);
    ensures within(a, 65535) ==> within(\result, 65535 * 2147483648); */
static inline int64_t fx_mul(int32_t a, int32_t b);

/*@ requires low <= high; assigns \nothing; ensures low <= \result <= high; */
static inline int32_t fx_saturate(int64_t x, int32_t low, int32_t high);

/*@ requires 1 <= n <= 31; assigns \nothing; */
static inline int64_t fx_floor_shift_wide(int64_t x, uint32_t n);

/*@ requires first == 0 && width == 26; assigns \nothing; ensures \result < 67108864; */
static inline uint32_t fx_field(uint32_t bits, uint32_t first, uint32_t width);

/*@ requires \valid(section) && \valid_read(coefficient_q26 + (0..4));
    requires \separated(section, coefficient_q26 + (0..4));
    requires legal_section(coefficient_q26) && legal_state(section) && bounded(x);
    assigns *section;
    ensures legal_state(section) && bounded(\result);
*/
static int32_t section_step(const int32_t coefficient_q26[FORCE_LAW_COEFFICIENTS],
                            force_section_t *section, int32_t x);

/*@ requires \valid(section) && bounded(x);
    assigns *section;
    ensures legal_state(section); */
static void settle(force_section_t *section, int32_t x);

/*@ requires \valid(law) && legal_bank(&law->bank) && legal_sections(law) && bounded(x);
    assigns law->sections[0..2];
    ensures legal_sections(law); */
static void begin(force_law_t *law, int32_t x);

/*@ requires \valid(law) && law->bank.integral_q26 <= 67108864;
    requires legal_integral(law) && bounded(proportional_q16);
    assigns law->integral_q16, law->integral_remainder_q26;
    ensures legal_integral(law); */
static void integrate(force_law_t *law, int32_t proportional_q16);

/*@ requires \valid(law) && legal_bank(&law->bank) && legal_sections(law) && legal_integral(law);
    assigns law->sections[0..2], law->integral_q16, law->integral_remainder_q26;
    ensures legal_sections(law);
    ensures legal_integral(law);
    ensures -134283264 <= \result <= 134217728; */
int32_t force_law_step(force_law_t *law, int32_t error_q8, int32_t velocity_cnt,
                       force_law_tick_t tick);

#include "firmware/core/force_law.c"
