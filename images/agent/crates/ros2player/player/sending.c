/* Sends datagrams no faster than processes of this machine take them, where the middleware is Cyclone DDS: Fast
 * DDS holds what its threads that receive need while it sends. What a program itself defines is found before
 * what libraries do, so that middlewares call these. */
#define _GNU_SOURCE
#include "sending.h"

#include <stdatomic.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "flow_control.h"
#include "ring.h"

#define PUBLIC __attribute__((visibility("default")))

_Atomic bool holds_back;

static bool by_the_clock(void) {
  return memory != NULL && atomic_load(&memory->by_the_clock) != 0;
}

PUBLIC ssize_t sendmsg(int socket, const struct msghdr *message, int flags) {
  if (atomic_load(&holds_back)) flow_control_wait_message(message, by_the_clock());
  return syscall(SYS_sendmsg, socket, message, flags);
}

PUBLIC ssize_t sendto(int socket, const void *data, size_t bytes, int flags, __CONST_SOCKADDR_ARG to,
                      socklen_t length) {
  const struct sockaddr *at = to.__sockaddr__;
  if (atomic_load(&holds_back)) flow_control_wait(at, length, bytes, by_the_clock());
  return syscall(SYS_sendto, socket, data, bytes, flags, at, length);
}
