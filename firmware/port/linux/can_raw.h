#ifndef FIRMWARE_PORT_LINUX_CAN_RAW_H_
#define FIRMWARE_PORT_LINUX_CAN_RAW_H_

/* A raw SocketCAN socket of Linux, for the port (can_line.h) and the programs of host
 * (host/canopen/can_socket.hpp). */

#include <linux/can.h>
#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { CAN_RAW_BATCH = 16, CAN_RAW_NAME = 16 };

typedef struct {
  struct can_filter filter; /* filter for data frames */
  can_err_mask_t errors;    /* set of the classes of error frames that are received */
  bool blocks;              /* true: can_raw_receive() waits for a frame */
  int buffer_bytes;         /* size of the receive buffer in bytes; 0: the default size, and dropped
                             * frames are not counted */
} can_raw_settings_t;

typedef struct {
  int fd;
  can_raw_settings_t settings;
  char interface[CAN_RAW_NAME];
  /* number of frames that the kernel has dropped since the socket was opened; the number wraps */
  uint32_t dropped;
} can_raw_t;

/* The reason why a socket was not opened. errno has the details. */
typedef enum {
  CAN_RAW_OPEN,
  CAN_RAW_NO_CAN,       /* the kernel has no SocketCAN */
  CAN_RAW_BAD_NAME,     /* the given name is not a valid name of an interface */
  CAN_RAW_NO_INTERFACE, /* no interface has this name */
  CAN_RAW_REFUSED       /* the interface exists, but cannot be used */
} can_raw_result_t;

/* Opens a CAN interface. The interface may be down. After a failure the socket is closed. */
can_raw_result_t can_raw_open(can_raw_t *raw, const char *interface,
                              const can_raw_settings_t *settings);

/* Connects the socket to its interface again after the interface was removed and created again.
 * Returns false if there is no interface with this name. */
bool can_raw_bind(const can_raw_t *raw);

/* State of an interface. If the controller of a CAN interface is bus off, the interface is up and
 * has no carrier. */
typedef struct {
  bool is_up;
  bool has_carrier;
} can_raw_link_t;
can_raw_link_t can_raw_link(const can_raw_t *raw);

/* Sends the first of `count` frames, at most CAN_RAW_BATCH. Returns the number of frames that the
 * interface has accepted, at least 1, or -errno. The error is -ENOBUFS or -EAGAIN if the queue of
 * the interface is full. */
int can_raw_send(const can_raw_t *raw, const struct can_frame *frames, unsigned count);

/* Receives the waiting frames, at most `count` and at most CAN_RAW_BATCH. Returns the number of
 * received frames or -errno. The error is -EAGAIN if no frame waits, -ENETDOWN once after the
 * interface went down, and -ENODEV once after the interface was removed. */
int can_raw_receive(can_raw_t *raw, struct can_frame *frames, unsigned count);

#ifdef __cplusplus
}
#endif

#endif
