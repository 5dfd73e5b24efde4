#include "firmware/port/port.h"
#include "firmware/port/stm32f4/barrier.h"
#include "firmware/port/stm32f4/board.h"

enum { PIN_RX = 8, PIN_TX = 9, FUNCTION_CAN1 = 9 };

/* Number of frames in the ring buffer, a power of 2. At most 14 frames arrive between two ticks:
 * the shortest frames at 1 Mbit/s. */
enum { RING = 32 };

/* Longest time in ticks in which the CAN controller must join the bus, before the initialisation is
 * repeated: 1500 ticks (one second) plus 9 ticks for each step of the prescaler. A node joins the
 * bus after 11 recessive bits. After bus off the controller waits for 128 sequences of 11 recessive
 * bits, only in normal mode (RM0090 32.7.6). On an idle bus this takes 2.2 ticks at 1 Mbit/s. On a
 * full bus each frame of at most 135 bits has only one such sequence, so 128 sequences take 9 ticks
 * for each step of the prescaler. */
enum { PATIENCE_TICKS = 1500, PATIENCE_TICKS_OF_PRESCALER = 9 };

/* Number of ticks (100 ms) after which a frame that an error passive node could not send is too
 * old. Three of the longest frames take 41 ms at 10 kbit/s. */
enum { STALE_TICKS = 150 };

/* Bit timing of CAN. A bit has 14 quanta; at 1000 kbit/s a quantum is 3 cycles of 42 MHz. With an
 * external clock the sample point is after 12 quanta, at 86 % of the bit (CiA 301: 87.5 %): the
 * clocks of two nodes may then differ by 1.1 %, far more than crystals do. The internal oscillator
 * has an error of 1 % and needs three quanta for resynchronisation after the sample point: the
 * sample point is at 79 %, and a node with a crystal may differ by 1.7 %. */
#define QUANTA 14u
#define BIT_TIMING (CAN_BTR_TS1_11 | CAN_BTR_TS2_2 | CAN_BTR_SJW_2)
#define BIT_TIMING_INTERNAL (CAN_BTR_TS1_10 | CAN_BTR_TS2_3 | CAN_BTR_SJW_3)

/* Mode of the CAN controller: it sends frames in the order of their arrival, keeps the received
 * frames of a full FIFO, repeats a failed frame, does not return from bus off by itself, and does
 * not sleep. */
#define MODE (CAN_MCR_TXFP | CAN_MCR_RFLM)

static can_frame_t ring[RING];
static volatile uint8_t ring_in;  /* index in `ring` that only the interrupt writes */
static volatile uint8_t ring_out; /* index in `ring` that only the main loop writes */
/* number of frames for which the ring buffer had no room; written by the interrupt */
static volatile uint16_t dropped;
static uint16_t dropped_reported;

static enum { STOPPED, ENTERING, JOINING, RUNNING } state;
static uint32_t waited_ticks;
/* number of ticks in which the node was error passive and could send no frame */
static uint16_t stalled_ticks;
static uint32_t prescaler = CLOCK_APB1_HZ / (QUANTA * 1000000u);
static uint8_t reported;

/* Aborts the frames that wait in the mailboxes. */
static void abort_all(void) { CAN1->TSR = CAN_TSR_ABRQ0 | CAN_TSR_ABRQ1 | CAN_TSR_ABRQ2; }

static void enter_initialisation(void) {
  CAN1->MCR = MODE | CAN_MCR_INRQ;
  state = ENTERING;
  waited_ticks = 0;
}

/* Sets the bit timing, which can only be written during initialisation, and joins the bus. One
 * filter accepts every frame with an 11-bit identifier into FIFO 0. */
static void configure_and_join(void) {
  CAN1->BTR = (clock_is_external() ? BIT_TIMING : BIT_TIMING_INTERNAL) | CAN_BTR_BRP(prescaler);
  CAN1->FMR |= CAN_FMR_FINIT;
  CAN1->FA1R = 0;
  CAN1->FM1R = 0;
  CAN1->FS1R = CAN_FS1R_FSC0;
  CAN1->FFA1R = 0;
  CAN1->F0R1 = 0;
  CAN1->F0R2 = CAN_RI0R_IDE;
  CAN1->FA1R = CAN_FA1R_FACT0;
  CAN1->FMR &= ~CAN_FMR_FINIT;
  CAN1->IER = CAN_IER_FMPIE0;
  CAN1->MCR = MODE;
  state = JOINING;
  waited_ticks = 0;
}

/* Requests the initialisation of the CAN controller; port_can_bus() continues the initialisation in
 * each tick. */
void can_init(bool clock_is_right) {
  if (!clock_is_right) {
    reported = CAN_BUS_OFF;
    return;
  }
  RCC->AHB1ENR |= RCC_AHB1ENR_GPIOBEN;
  RCC->APB1ENR |= RCC_APB1ENR_CAN1EN;
  (void)RCC->APB1ENR;
  pin_alternate(GPIOB, PIN_RX, FUNCTION_CAN1, PIN_PULL_UP);
  pin_alternate(GPIOB, PIN_TX, FUNCTION_CAN1, PIN_PULL_NONE);
  pin_speed(GPIOB, PIN_TX, PIN_SPEED_MEDIUM);
  NVIC->IPR5 = FIELD(0, 8, PRIORITY_BUS);
  NVIC->ISER0 = BIT(IRQ_CAN1_RX0);
  enter_initialisation();
}

/* Aborts frames that are too old. If no other node acknowledges the frames of an error passive
 * node, they stay in the mailboxes and are aborted after STALE_TICKS. Meanwhile port_can_transmit()
 * accepts further frames, which are lost too. */
static void give_up_stale(void) {
  const uint32_t empty = CAN_TSR_TME0 | CAN_TSR_TME1 | CAN_TSR_TME2;
  if (reported != CAN_BUS_PASSIVE || (CAN1->TSR & empty) == empty) {
    stalled_ticks = 0;
  } else if (stalled_ticks < STALE_TICKS) {
    stalled_ticks++;
  } else {
    abort_all();
  }
}

uint8_t port_can_bus(void) {
  switch (state) {
    case RUNNING: {
      const uint32_t errors = CAN1->ESR;
      reported = ((errors & CAN_ESR_EPVF) != 0) ? CAN_BUS_PASSIVE : CAN_BUS_ACTIVE;
      give_up_stale();
      if ((errors & CAN_ESR_BOFF) != 0) {
        reported = CAN_BUS_OFF;
        abort_all();
        enter_initialisation();
      }
      break;
    }
    case ENTERING:
      if ((CAN1->MSR & CAN_MSR_INAK) != 0) {
        configure_and_join();
      } else {
        waited_ticks++;
      }
      break;
    case JOINING:
      /* Bus off needs 128 sequences of 11 recessive bits: the first sequence ends the
       * initialisation, the last one ends bus off. */
      if ((CAN1->MSR & CAN_MSR_INAK) == 0 && (CAN1->ESR & CAN_ESR_BOFF) == 0) {
        state = RUNNING;
      } else {
        waited_ticks++;
      }
      break;
    default:
      break;
  }
  if (state != RUNNING &&
      waited_ticks >= PATIENCE_TICKS + PATIENCE_TICKS_OF_PRESCALER * prescaler) {
    reported = CAN_BUS_OFF;
    enter_initialisation();
  }
  return reported;
}

void port_can_rate(uint16_t kbit_s) {
  const uint32_t wanted = CLOCK_APB1_HZ / (QUANTA * 1000u * kbit_s);
  if (state == STOPPED || wanted == prescaler) {
    return;
  }
  prescaler = wanted;
  abort_all();
  enter_initialisation();
}

uint16_t port_can_lost(void) {
  if (state == STOPPED) {
    return 0;
  }
  uint16_t lost = (uint16_t)(dropped - dropped_reported);
  dropped_reported = (uint16_t)(dropped_reported + lost);
  /* The controller does not count lost frames, but at least one frame was lost. */
  if ((CAN1->RF0R & CAN_RF0R_FOVR0) != 0) {
    CAN1->RF0R = CAN_RF0R_FOVR0;
    lost++;
  }
  return lost;
}

bool port_can_receive(can_frame_t *frame) {
  if (ring_out == ring_in) {
    return false;
  }
  BARRIER();
  *frame = ring[ring_out % RING];
  BARRIER();
  ring_out++;
  return true;
}

static void unpack(uint8_t *bytes, uint32_t word) {
  for (uint8_t i = 0; i < 4; i++) {
    bytes[i] = (uint8_t)(word >> (8 * i));
  }
}

static uint32_t pack(const uint8_t *bytes) {
  return (uint32_t)bytes[0] | (uint32_t)bytes[1] << 8 | (uint32_t)bytes[2] << 16 |
         (uint32_t)bytes[3] << 24;
}

void can_interrupt(void) {
  if ((CAN1->RF0R & CAN_RF0R_FMP0) == 0) {
    return;
  }
  if ((uint8_t)(ring_in - ring_out) < RING) {
    can_frame_t *frame = &ring[ring_in % RING];
    const uint32_t length = CAN1->RDT0R & CAN_RDT0R_DLC;
    frame->id = (uint16_t)(CAN1->RI0R >> 21);
    frame->remote = ((CAN1->RI0R & CAN_RI0R_RTR) != 0) ? 1 : 0;
    /* CAN permits a length code above 8, which means 8 bytes. */
    frame->length = (uint8_t)((length > 8) ? 8 : length);
    unpack(&frame->data[0], CAN1->RDL0R);
    unpack(&frame->data[4], CAN1->RDH0R);
    BARRIER();
    ring_in++;
  } else {
    dropped++;
  }
  CAN1->RF0R = CAN_RF0R_RFOM0;
  /* Wait until the FIFO has released the frame that was read. Before the release, the FIFO would
   * show this frame again. */
  for (uint8_t polls = 0; polls < 8 && (CAN1->RF0R & CAN_RF0R_RFOM0) != 0; polls++) {
  }
}

bool port_can_transmit(const can_frame_t *frame) {
  static const uint32_t empty[] = {CAN_TSR_TME0, CAN_TSR_TME1, CAN_TSR_TME2};
  if (state != RUNNING) {
    return false;
  }
  const uint32_t status = CAN1->TSR;
  for (uint8_t i = 0; i < 3; i++) {
    if ((status & empty[i]) != 0) {
      reg_t *box = &CAN1->TI0R + 4 * i;
      const uint32_t head = CAN_TI0R_STID(frame->id) | ((frame->remote != 0) ? CAN_TI0R_RTR : 0);
      box[0] = head;
      box[1] = frame->length;
      box[2] = pack(&frame->data[0]);
      box[3] = pack(&frame->data[4]);
      box[0] = head | CAN_TI0R_TXRQ;
      return true;
    }
  }
  return stalled_ticks >= STALE_TICKS;
}
