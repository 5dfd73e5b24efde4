/* A library that is loaded before axis_linux: notes on standard error each CAN frame that a thread
 * other than the first one sends without holding a mutex. The tick thread sends the frames of the
 * drive, whose master other threads read under the lock of the port. */
#define _GNU_SOURCE

#include <dlfcn.h>
#include <linux/can.h>
#include <pthread.h>
#include <stddef.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>

static __thread int held;

typedef int (*mutex_call_t)(pthread_mutex_t *mutex);
typedef int (*send_call_t)(int fd, struct mmsghdr *messages, unsigned count, int flags);

static mutex_call_t lock;
static mutex_call_t unlock;
static send_call_t send_all;

/* dlsym() takes too long for each tick of a loaded machine. */
__attribute__((constructor)) static void find(void) {
  lock = (mutex_call_t)dlsym(RTLD_NEXT, "pthread_mutex_lock");
  unlock = (mutex_call_t)dlsym(RTLD_NEXT, "pthread_mutex_unlock");
  send_all = (send_call_t)dlsym(RTLD_NEXT, "sendmmsg");
}

static void note(void) {
  static const char text[] = "axis_linux: a frame was sent without the lock\n";
  if (held == 0 && syscall(SYS_gettid) != getpid()) {
    (void)syscall(SYS_write, 2, text, sizeof(text) - 1);
  }
}

int pthread_mutex_lock(pthread_mutex_t *mutex) {
  if (lock == NULL) {
    find();
  }
  const int result = lock(mutex);
  held++;
  return result;
}

int pthread_mutex_unlock(pthread_mutex_t *mutex) {
  held--;
  return unlock(mutex);
}

ssize_t write(int fd, const void *data, size_t count) {
  if (count == sizeof(struct can_frame)) {
    note();
  }
  return syscall(SYS_write, fd, data, count);
}

int sendmmsg(int fd, struct mmsghdr *messages, unsigned count, int flags) {
  note();
  return send_all(fd, messages, count, flags);
}
