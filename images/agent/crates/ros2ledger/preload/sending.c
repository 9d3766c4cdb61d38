/* Sends what a node publishes no faster than processes of this machine take it, if the ledger's reader asks for
 * that. What a process sends otherwise goes out as ever. */
#define _GNU_SOURCE
#include "sending.h"

#include <errno.h>
#include <string.h>
#include <sys/socket.h>

#include "attach.h"
#include "flow_control.h"
#include "interpose.h"

/* Fast DDS holds what its threads that receive need while it sends: two nodes that wait for each other's
 * sockets would wait until one gives up. It has shared memory for large messages. */
#define HELD_BACK "rmw_cyclonedds_cpp"

/* Calls that publish, one inside of the other; how many of them are of a middleware that is held back. */
static __thread struct {
  uint32_t all, held;
} publishing __attribute__((tls_model("initial-exec")));

void sending_begin(const struct endpoint_head *publisher) {
  const char *is = publisher == NULL ? NULL : publisher->implementation;
  publishing.all++;
  if (publishing.held > 0 || (is != NULL && strcmp(is, HELD_BACK) == 0)) publishing.held++;
}

/* 0 already: a child began inside of its parent's call. */
void sending_end(void) {
  if (publishing.all > 0) publishing.all--;
  if (publishing.held > publishing.all) publishing.held = publishing.all;
}

void sending_in_child(void) {
  publishing.all = publishing.held = 0;
  flow_control_in_child();
}

static enum ledger_flow asked(void) {
  uint32_t entry;
  struct ledger *ledger = publishing.held > 0 ? attached(&entry) : NULL;
  return ledger == NULL ? FLOW_FREE : (enum ledger_flow)atomic_load(&ledger->header.flow);
}

PUBLIC ssize_t sendmsg(int socket, const struct msghdr *message, int flags) {
  NEXT(sendmsg, "libc.so.6", (errno = ENOSYS, -1))
  enum ledger_flow flow = asked();
  if (flow != FLOW_FREE) flow_control_wait_message(message, flow == FLOW_BY_THE_CLOCK);
  return next(socket, message, flags);
}

PUBLIC ssize_t sendto(int socket, const void *data, size_t bytes, int flags, __CONST_SOCKADDR_ARG to,
                      socklen_t length) {
  NEXT(sendto, "libc.so.6", (errno = ENOSYS, -1))
  enum ledger_flow flow = asked();
  if (flow != FLOW_FREE) flow_control_wait(to.__sockaddr__, length, bytes, flow == FLOW_BY_THE_CLOCK);
  return next(socket, data, bytes, flags, to, length);
}

/* A signal may send before anything else has, and must not look names up. */
__attribute__((constructor)) static void find_both(void) {
  struct msghdr none = {.msg_iovlen = 0};
  int before = errno;
  sendmsg(-1, &none, 0);
  sendto(-1, NULL, 0, 0, (struct sockaddr *)NULL, 0);
  errno = before;
}
