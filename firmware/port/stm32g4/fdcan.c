/* The functions of firmware/port/stm32/can.h for the CAN controllers of this chip (FDCAN). They
 * send and receive only classic frames. Each controller has a memory for frames with a fixed layout
 * (RM0440, FDCAN message RAM). */

#include <stddef.h>

#include "firmware/fx/bytes.h"
#include "firmware/port/stm32/board.h"
#include "firmware/port/stm32/can.h"

enum { FUNCTION_FDCAN = 9 };
enum { PIN_RX = 11, PIN_TX = 12 };           /* pin numbers, on port A, of the CAN of the axis */
enum { DRIVE_PIN_RX = 5, DRIVE_PIN_TX = 6 }; /* pin numbers, on port B, of the CAN of a drive */

/* Bit timing of CAN. With the crystal a bit has 24 quanta; at 1000 kbit/s a quantum is one cycle of
 * 24 MHz. The sample point is after 21 quanta, at 87.5 % of the bit (CiA 301). If the crystal does
 * not run, the clock of the controllers is that of APB1, and a bit has 14 quanta. The internal
 * oscillator has an error of 1 %, so three quanta for resynchronisation are needed after the sample
 * point. The sample point is then at 79 % of the bit. */
enum { QUANTA = 24, CLOCK_KHZ = 24000 };
enum { QUANTA_INTERNAL = 14, CLOCK_INTERNAL_KHZ = 42000 };
#define BIT_TIMING (FDCAN_NBTP_NTSEG1(20) | FDCAN_NBTP_NTSEG2(3) | FDCAN_NBTP_NSJW(3))
#define BIT_TIMING_INTERNAL (FDCAN_NBTP_NTSEG1(10) | FDCAN_NBTP_NTSEG2(3) | FDCAN_NBTP_NSJW(3))

/* Indices of the words of a frame in the memory of a controller. The first word has the identifier,
 * and the second word has the length. */
enum { FRAME_ID = 0, FRAME_LENGTH = 1, FRAME_DATA = 2 };
#define FRAME_ID_STANDARD MASK(18, 11)
#define FRAME_ID_REMOTE BIT(29)
#define FRAME_LENGTH_DLC MASK(16, 4)

static reg_t *frame_at(const can_line_t *line, uint32_t offset, uint32_t index) {
  reg_t *memory = (reg_t *)FDCAN_MEMORY_BASE;
  if (line->registers != FDCAN1) {
    memory += FDCAN_MEMORY_WORDS;
  }
  return memory + offset + index * FDCAN_FRAME_WORDS;
}

static uint32_t bit_timing(uint16_t kbit_s) {
  return clock_is_external()
             ? BIT_TIMING | FDCAN_NBTP_NBRP(CLOCK_KHZ / ((uint32_t)QUANTA * kbit_s))
             : BIT_TIMING_INTERNAL |
                   FDCAN_NBTP_NBRP(CLOCK_INTERNAL_KHZ / ((uint32_t)QUANTA_INTERNAL * kbit_s));
}

void can_controller_connect_axis(void) {
  RCC->CCIPR =
      (RCC->CCIPR & ~RCC_CCIPR_FDCANSEL) | (clock_is_external() ? 0 : RCC_CCIPR_FDCANSEL_PCLK1);
  set_bits(&RCC->APB1ENR1, RCC_APB1ENR1_FDCANEN);
  pin_alternate(GPIOA, PIN_RX, FUNCTION_FDCAN, PIN_PULL_UP);
  pin_alternate(GPIOA, PIN_TX, FUNCTION_FDCAN, PIN_PULL_NONE);
  pin_speed(GPIOA, PIN_TX, PIN_SPEED_MEDIUM);
  NVIC->IPR5 = FIELD(8, 8, PRIORITY_BUS);
  NVIC->ISER0 = BIT(IRQ_FDCAN1_IT0);
}

void can_controller_connect_drive(void) {
  pin_alternate(GPIOB, DRIVE_PIN_RX, FUNCTION_FDCAN, PIN_PULL_UP);
  pin_alternate(GPIOB, DRIVE_PIN_TX, FUNCTION_FDCAN, PIN_PULL_NONE);
  pin_speed(GPIOB, DRIVE_PIN_TX, PIN_SPEED_MEDIUM);
  NVIC->IPR21 = FIELD(16, 8, PRIORITY_BUS) | FIELD(24, 8, PRIORITY_BUS);
  NVIC->ISER2 = BIT(IRQ_FDCAN2_IT0 - 64) | BIT(IRQ_FDCAN2_IT1 - 64);
}

/* Requests the initialisation. A controller sets the same bit itself when it is bus off. All other
 * bits of CCCR are 0. */
void can_controller_enter(can_line_t *line) { line->registers->CCCR = FDCAN_CCCR_INIT; }

bool can_controller_has_entered(const can_line_t *line) {
  return (line->registers->CCCR & FDCAN_CCCR_INIT) != 0;
}

/* Configures the controller and requests the end of the initialisation. The bit CCE permits a
 * configuration; it also discards waiting frames. Every received frame with an 11-bit identifier is
 * put into FIFO 0. If the FIFO is full, its frames are kept. Frames are sent in the order in which
 * they were written, and a failed frame is repeated. */
void can_controller_join(can_line_t *line) {
  fdcan_t *can = line->registers;
  can->CCCR = FDCAN_CCCR_INIT;
  can->CCCR = FDCAN_CCCR_INIT | FDCAN_CCCR_CCE;
  can->NBTP = bit_timing(line->kbit_s);
  can->RXGFC = FDCAN_RXGFC_RRFE | FDCAN_RXGFC_ANFE_REJECT | FDCAN_RXGFC_ANFS_FIFO_0;
  can->TXBC = 0;
  can->TXBTIE = line->reports_sent ? FDCAN_TXBTIE_TIE : 0;
  can->ILS = FDCAN_ILS_SMSG;
  can->IE = FDCAN_IE_RF0NE | (line->reports_sent ? FDCAN_IE_TCE : 0);
  can->ILE = FDCAN_ILE_EINT0 | FDCAN_ILE_EINT1;
  can->CCCR = 0;
}

/* Returns true if the controller has joined the bus. After the end of the initialisation, a
 * controller that was bus off waits for 129 sequences of 11 recessive bits. ACT is 0 until the
 * controller has seen 11 recessive bits. */
bool can_controller_has_joined(const can_line_t *line) {
  const uint32_t status = line->registers->PSR;
  return (line->registers->CCCR & FDCAN_CCCR_INIT) == 0 && (status & FDCAN_PSR_BO) == 0 &&
         (status & FDCAN_PSR_ACT) != 0;
}

uint8_t can_controller_bus(const can_line_t *line) {
  const uint32_t status = line->registers->PSR;
  if ((status & FDCAN_PSR_BO) != 0) {
    return CAN_BUS_OFF;
  }
  return ((status & FDCAN_PSR_EP) != 0) ? CAN_BUS_PASSIVE : CAN_BUS_ACTIVE;
}

bool can_controller_is_empty(const can_line_t *line) {
  return (line->registers->TXBRP & FDCAN_TXBRP_TRP) == 0;
}

/* Returns false, because frames are discarded only by a new initialisation. The register TXBCR can
 * discard single frames only if the frames are in a queue, and a queue would not keep the order of
 * the frames. */
bool can_controller_abort(can_line_t *line) {
  (void)line;
  return false;
}

bool can_controller_lost(can_line_t *line) {
  const bool is_lost = (line->registers->IR & FDCAN_IR_RF0L) != 0;
  if (is_lost) {
    line->registers->IR = FDCAN_IR_RF0L;
  }
  return is_lost;
}

/* The interrupt request is cleared before the FIFO is read. So a frame that is received later
 * requests the interrupt again. */
bool can_controller_take(can_line_t *line, can_frame_t *frame) {
  fdcan_t *can = line->registers;
  can->IR = FDCAN_IR_RF0N;
  const uint32_t status = can->RXF0S;
  if ((status & FDCAN_RXF0S_F0FL) == 0) {
    return false;
  }
  const uint32_t index = (status & FDCAN_RXF0S_F0GI) >> 8;
  if (frame != NULL) {
    const reg_t *words = frame_at(line, FDCAN_MEMORY_RXF0, index);
    const uint32_t head = words[FRAME_ID];
    const uint32_t length = (words[FRAME_LENGTH] & FRAME_LENGTH_DLC) >> 16;
    frame->id = (uint16_t)((head & FRAME_ID_STANDARD) >> 18);
    frame->remote = ((head & FRAME_ID_REMOTE) != 0) ? 1 : 0;
    /* CAN permits a length code above 8. Such a code means 8 bytes. */
    frame->length = (uint8_t)((length > 8) ? 8 : length);
    fx_store_le(&frame->data[0], words[FRAME_DATA], 4);
    fx_store_le(&frame->data[4], words[FRAME_DATA + 1], 4);
  }
  can->RXF0A = index;
  return true;
}

bool can_controller_send(can_line_t *line, const can_frame_t *frame) {
  fdcan_t *can = line->registers;
  const uint32_t status = can->TXFQS;
  if ((status & FDCAN_TXFQS_TFQF) != 0) {
    return false;
  }
  const uint32_t index = (status & FDCAN_TXFQS_TFQPI) >> 16;
  reg_t *words = frame_at(line, FDCAN_MEMORY_TX, index);
  words[FRAME_ID] = FIELD(18, 11, frame->id) | ((frame->remote != 0) ? FRAME_ID_REMOTE : 0);
  words[FRAME_LENGTH] = FIELD(16, 4, frame->length);
  words[FRAME_DATA] = fx_load_le32(&frame->data[0]);
  words[FRAME_DATA + 1] = fx_load_le32(&frame->data[4]);
  can->TXBAR = UINT32_C(1) << index;
  return true;
}

void can_controller_note_sent(can_line_t *line) { line->registers->IR = FDCAN_IR_TC; }
