/* The beginning and the end: threads are started and waited for. */
#define _GNU_SOURCE
#include <linux/futex.h>
#include <pthread.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#include "player.h"

#define END_US 700000 /* what leaving the graph may take */

static _Atomic uint32_t threads;

bool thread_start(void *(*body)(void *)) {
  pthread_t thread;
  atomic_fetch_add(&threads, 1);
  if (pthread_create(&thread, NULL, body, NULL) == 0) return true;
  thread_ends();
  return false;
}

void thread_ends(void) {
  if (atomic_fetch_sub(&threads, 1) == 1)
    syscall(SYS_futex, &threads, FUTEX_WAKE, 1, NULL, NULL, 0);
}

void start(struct request *from, struct answer *into) {
  const char *name = request_text(from), *space = request_text(from);
  if (from->wrong) {
    answer_failed(into, STATUS_REQUEST, "it names no node");
    return;
  }
  if (!middleware_join(name, space, into)) return;
  if (!thread_start(publish_all) || !thread_start(take_all))
    answer_failed(into, STATUS_REQUEST, "no thread is to be had");
  else
    answer_number(into, STATUS_DONE);
}

static void give_up(int signal) {
  (void)signal;
  _exit(3);
}

void end(int socket) {
  struct itimerval limit = {{0, 0}, {0, END_US}};
  signal(SIGALRM, give_up);
  setitimer(ITIMER_REAL, &limit, NULL);
  atomic_store(&ending, 1);
  shutdown(socket, SHUT_RDWR);
  for (uint32_t left; (left = atomic_load(&threads)) != 0;) {
    struct timespec slice = {0, 50000000};
    ring_wake();
    messages_wake();
    syscall(SYS_futex, &threads, FUTEX_WAIT, left, &slice, NULL, 0);
  }
  publishers_end();
  subscriptions_end();
  middleware_leave();
  _exit(0);
}
