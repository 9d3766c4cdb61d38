/* The beginning and the end: ROS 2 is loaded and left again, threads are started and waited for. */
#define _GNU_SOURCE
#include <linux/futex.h>
#include <pthread.h>
#include <signal.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#include "player.h"

/* The name that a C library of 2020 has too. */
#if defined(__x86_64__)
__asm__(".symver pthread_create, pthread_create@GLIBC_2.2.5");
#elif defined(__aarch64__)
__asm__(".symver pthread_create, pthread_create@GLIBC_2.17");
#endif

#define END_US 700000 /* what leaving the graph may take */

struct blob context, node;

static bool with_context, with_node;
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

static bool load(struct answer *into) {
  bool symbol;
  const char *missing = rcl_load(&symbol);
  if (missing != NULL) answer_failed(into, symbol ? STATUS_SYMBOL : STATUS_LIBRARY, missing);
  return missing == NULL;
}

static bool join_graph(const char *name, const char *space, struct answer *into) {
  struct blob options;
  memset(&options, 0, sizeof options);
  int failed = rcl.rcl_init_options_init(&options, rcl.rcutils_get_default_allocator());
  if (failed) {
    answer_rcl(into, "rcl_init_options_init", failed);
    return false;
  }
  failed = rcl.rcl_init(0, NULL, &options, &context);
  if (failed) {
    answer_rcl(into, "rcl_init", failed);
    return false;
  }
  with_context = true;
  struct blob node_options = rcl.rcl_node_get_default_options();
  failed = rcl.rcl_node_init(&node, name, space, &context, &node_options);
  if (failed) answer_rcl(into, "rcl_node_init", failed);
  with_node = !failed;
  return with_node;
}

void start(struct request *from, struct answer *into) {
  const char *name = request_text(from), *space = request_text(from);
  if (from->wrong) {
    answer_failed(into, STATUS_REQUEST, "it names no node");
    return;
  }
  if (!load(into) || !join_graph(name, space, into) || !take_prepare(into)) return;
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
    take_wake();
    syscall(SYS_futex, &threads, FUTEX_WAIT, left, &slice, NULL, 0);
  }
  publishers_end();
  subscriptions_end();
  if (with_node) (void)!rcl.rcl_node_fini(&node);
  if (with_context && rcl.rcl_shutdown(&context) == RCL_OK)
    (void)!rcl.rcl_context_fini(&context);
  _exit(0);
}
