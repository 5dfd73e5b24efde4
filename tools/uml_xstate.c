/* Lets the user-mode Linux 6.1 of Debian run on a processor with AMX, loaded with LD_PRELOAD.
 *
 * Between two processes of the guest it keeps the extended registers with PTRACE_GETREGSET and
 * PTRACE_SETREGSET, in a buffer as large as AVX-512 needs. A host kernel gives less than the whole
 * state, but takes only the whole: EFAULT, at which user-mode Linux aborts. Here a set begins with
 * the state as it stands and replaces the part that was kept. No program of a guest can use AMX:
 * its kernel has no call that permits it.
 */
#define _GNU_SOURCE
#include <elf.h>
#include <errno.h>
#include <stdarg.h>
#include <string.h>
#include <sys/ptrace.h>
#include <sys/syscall.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

enum { LARGEST_BYTES = 16384 };  // the state with AMX has 11008

// The call itself returns 0 or -1 for all requests that are made here and peeks through `data`.
static long request_of(long request, long pid, void *address, void *data) {
  return syscall(SYS_ptrace, request, pid, address, data);
}

long ptrace(enum __ptrace_request request, ...) {
  va_list given;
  va_start(given, request);
  const pid_t pid = va_arg(given, pid_t);
  void *const address = va_arg(given, void *);
  void *const data = va_arg(given, void *);
  va_end(given);
  if (request == PTRACE_PEEKTEXT || request == PTRACE_PEEKDATA || request == PTRACE_PEEKUSER) {
    long word = 0;
    return request_of(request, pid, address, &word) < 0 ? -1 : (errno = 0, word);
  }
  if (request != PTRACE_SETREGSET || (size_t)address != NT_X86_XSTATE)
    return request_of(request, pid, address, data);
  static _Thread_local unsigned char whole[LARGEST_BYTES];
  const struct iovec *const kept = data;
  struct iovec all = {whole, sizeof whole};
  if (request_of(PTRACE_GETREGSET, pid, address, &all) < 0) return -1;
  if (kept->iov_len < all.iov_len) {
    memcpy(whole, kept->iov_base, kept->iov_len);
    return request_of(request, pid, address, &all);
  }
  return request_of(request, pid, address, data);
}
