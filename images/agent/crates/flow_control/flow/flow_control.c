/* Loopback holds no sender up: what finds no room in the receiver's socket is thrown away. A message that
 * is larger than that room (208 KiB unless the machine gives more) then reaches a reader of best
 * effort by luck alone, and a reliable one by repetitions, each after tens of milliseconds. The kernel
 * shows by sock_diag(7) how much waits in a socket, also of another process in the network namespace. */
#define _GNU_SOURCE
#include "flow_control.h"

#include <arpa/inet.h>
#include <errno.h>
#include <linux/inet_diag.h>
#include <linux/netlink.h>
#include <linux/rtnetlink.h>
#include <linux/sock_diag.h>
#include <netinet/in.h>
#include <stdatomic.h>
#include <stdint.h>
#include <string.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#define RECEIVERS 512u /* more are not held back; a power of two */
#define PAUSE_NS 50000
#define TRIES 200 /* a pause each, for who has the lock */
/* So long nothing is taken by who has stopped; who gets no processor for a while, or reads slowly, has
 * not: what was read the kernel (udp_rmem_release) shows in quarters of the buffer. */
#define PATIENCE_NS 1000000000
/* By the clock what is due next waits as well: so long at most, and no more than a part of the time. */
#define LATE_NS 20000000
#define LATE_PART 4
/* Bytes that are sent to who is not found before it is looked for again. */
#define UNKNOWN 1000000
#define MOST_BYTES 65507 /* of a datagram */

struct receiver {
  struct sockaddr_in at; /* sin_port 0: a free place */
  int64_t room;          /* as the kernel counts it, before it is asked again */
  uint32_t waiting;      /* when it was asked last */
  bool foreign;          /* another machine's, which nothing is known of */
  bool stopped;          /* it took nothing for so long, and is not waited for until it does */
};

/* What waits in a socket, and what may, as the kernel counts both. */
struct load {
  uint32_t waiting, most;
};

static atomic_flag lock = ATOMIC_FLAG_INIT; /* old C libraries have pthread_mutex_trylock elsewhere */
static struct receiver receivers[RECEIVERS];
static int diagnosis = -1; /* a socket of sock_diag */
static int64_t late_left = LATE_NS, late_at; /* how long may be waited by the clock, and since when */

static const struct timespec A_PAUSE = {0, PAUSE_NS};

/* Whoever has it may be what this signal has interrupted: then nobody is held back. */
static bool take_lock(void) {
  for (int tries = 0; tries < TRIES; tries++) {
    if (!atomic_flag_test_and_set_explicit(&lock, memory_order_acquire)) return true;
    nanosleep(&A_PAUSE, NULL);
  }
  return false;
}

static void free_lock(void) { atomic_flag_clear_explicit(&lock, memory_order_release); }

static int64_t now_ns(void) {
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

/* The most that the kernel counts for a datagram: its memory comes in powers of two, with headers and
 * the kernel's own notes (skb_shared_info and sk_buff, together less than 768 bytes). */
static int64_t charge(size_t bytes) {
  int64_t memory = 512;
  while (memory < (int64_t)bytes + 512) memory *= 2;
  return memory + 256;
}

/* Whether an address is one of this machine's, of loopback or not: middlewares send to the interface that they
 * have chosen, also where the reader is on the same machine. To others no socket can be bound. */
static bool is_own(struct in_addr address) {
  uint32_t number = ntohl(address.s_addr);
  if (number >> 24 == IN_LOOPBACKNET) return true;
  if (IN_MULTICAST(number) || number == INADDR_ANY || number == INADDR_BROADCAST) return false;
  int trial = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (trial < 0) return false;
  struct sockaddr_in any_port = {.sin_family = AF_INET, .sin_addr = address};
  bool own = bind(trial, (struct sockaddr *)&any_port, sizeof any_port) == 0;
  close(trial);
  return own;
}

static struct receiver *find(const struct sockaddr_in *at) {
  uint32_t first = ntohs(at->sin_port) * 31u + ntohl(at->sin_addr.s_addr);
  for (uint32_t probe = 0; probe < RECEIVERS; probe++) {
    struct receiver *one = &receivers[(first + probe) % RECEIVERS];
    if (one->at.sin_port == 0) {
      one->at = *at;
      one->foreign = !is_own(at->sin_addr);
    }
    if (one->at.sin_port == at->sin_port && one->at.sin_addr.s_addr == at->sin_addr.s_addr)
      return one;
  }
  return NULL;
}

static bool read_load(const struct nlmsghdr *header, struct load *into) {
  if (header->nlmsg_type != SOCK_DIAG_BY_FAMILY) return false;
  size_t rest = header->nlmsg_len - NLMSG_LENGTH(0);
  if (rest < sizeof(struct inet_diag_msg)) return false;
  rest -= NLMSG_ALIGN(sizeof(struct inet_diag_msg));
  const struct inet_diag_msg *found = NLMSG_DATA(header);
  for (const struct rtattr *one = (const struct rtattr *)(found + 1); RTA_OK(one, rest);
       one = RTA_NEXT(one, rest)) {
    if (one->rta_type != INET_DIAG_SKMEMINFO) continue;
    uint32_t memory[SK_MEMINFO_RCVBUF + 1];
    if (RTA_PAYLOAD(one) < sizeof memory) return false;
    memcpy(memory, RTA_DATA(one), sizeof memory);
    *into = (struct load){memory[SK_MEMINFO_RMEM_ALLOC], memory[SK_MEMINFO_RCVBUF]};
    return true;
  }
  return false;
}

/* The answer to the question of this number; one to an earlier question is passed over. */
static bool read_answer(uint32_t number, struct load *into) {
  for (;;) {
    _Alignas(struct nlmsghdr) char answer[1024];
    ssize_t length = recv(diagnosis, answer, sizeof answer, MSG_DONTWAIT);
    const struct nlmsghdr *header = (const struct nlmsghdr *)answer;
    if (length < 0 || !NLMSG_OK(header, (size_t)length)) return false;
    if (header->nlmsg_seq == number) return read_load(header, into);
  }
}

/* False where no such socket is found, or the kernel does not answer. */
static bool ask(const struct sockaddr_in *at, struct load *into) {
  static uint32_t number;
  if (diagnosis < 0) diagnosis = socket(AF_NETLINK, SOCK_RAW | SOCK_CLOEXEC, NETLINK_SOCK_DIAG);
  if (diagnosis < 0) return false;
  struct {
    struct nlmsghdr header;
    struct inet_diag_req_v2 wanted;
  } question = {
      {.nlmsg_len = sizeof question,
       .nlmsg_type = SOCK_DIAG_BY_FAMILY,
       .nlmsg_flags = NLM_F_REQUEST,
       .nlmsg_seq = ++number},
      {.sdiag_family = AF_INET,
       .sdiag_protocol = IPPROTO_UDP,
       .idiag_ext = 1 << (INET_DIAG_SKMEMINFO - 1),
       .idiag_states = UINT32_MAX}};
  /* Of one socket, in place of a list, the kernel takes the receiving end as `dst`. */
  question.wanted.id.idiag_dport = at->sin_port;
  question.wanted.id.idiag_dst[0] = at->sin_addr.s_addr;
  memset(question.wanted.id.idiag_cookie, 0xff, sizeof question.wanted.id.idiag_cookie);
  /* Of a socket that others have closed, the number may be another's by now. */
  struct sockaddr_nl kernel = {.nl_family = AF_NETLINK};
  ssize_t went = syscall(SYS_sendto, diagnosis, &question, sizeof question, MSG_DONTWAIT, &kernel,
                         sizeof kernel);
  if (went != sizeof question) {
    if (errno != EAGAIN && errno != ENOBUFS && errno != ENOMEM) diagnosis = -1;
    return false;
  }
  return read_answer(number, into);
}

/* Whether so much may go out now; half of the room is left to what others send. A quarter may wait where
 * a datagram needs more: kernels of 2019 count that of a socket that is empty. */
static bool has_room(struct receiver *receiver, int64_t needs, struct load *load) {
  if (receiver->room >= needs) return true;
  if (!ask(&receiver->at, load)) {
    receiver->room = UNKNOWN;
    return true;
  }
  receiver->room = (int64_t)load->most / 2 - load->waiting;
  bool room = load->waiting <= load->most / 4 || receiver->room >= needs;
  if (room || load->waiting < receiver->waiting) receiver->stopped = false;
  receiver->waiting = load->waiting;
  return room;
}

/* Whether somebody may be waited for; by the clock not for long. */
static bool may_wait(int64_t now, bool by_the_clock) {
  if (!by_the_clock) return true;
  late_left += (now - late_at) / LATE_PART;
  late_at = now;
  if (late_left > LATE_NS) late_left = LATE_NS;
  return late_left > 0;
}

/* Pauses with the lock free; false where it could not be had again. */
static bool pause_for(int64_t since, bool by_the_clock) {
  free_lock();
  nanosleep(&A_PAUSE, NULL);
  if (!take_lock()) return false;
  if (by_the_clock) late_left -= now_ns() - since;
  return true;
}

static void await_room(const struct sockaddr_in *at, size_t bytes, bool by_the_clock) {
  int64_t needs = charge(bytes), since = 0;
  uint32_t least = UINT32_MAX;
  struct load load = {0, 0};
  if (!take_lock()) return;
  struct receiver *receiver = find(at);
  if (receiver != NULL && receiver->foreign) receiver = NULL;
  while (receiver != NULL && !has_room(receiver, needs, &load) && !receiver->stopped) {
    int64_t now = now_ns();
    if (load.waiting < least) {
      least = load.waiting;
      since = now;
    }
    receiver->stopped = now - since >= PATIENCE_NS;
    if (receiver->stopped || !may_wait(now, by_the_clock)) break;
    if (!pause_for(now, by_the_clock)) return;
  }
  if (receiver != NULL) receiver->room = receiver->room > needs ? receiver->room - needs : 0;
  free_lock();
}

void flow_control_wait(const struct sockaddr *at, socklen_t length, size_t bytes, bool by_the_clock) {
  if (at == NULL || length < sizeof(struct sockaddr_in) || at->sa_family != AF_INET) return;
  if (bytes > MOST_BYTES) return;
  const struct sockaddr_in *inet = (const struct sockaddr_in *)at;
  if (inet->sin_port == 0) return;
  int before = errno;
  await_room(inet, bytes, by_the_clock);
  errno = before;
}

void flow_control_wait_message(const struct msghdr *message, bool by_the_clock) {
  if (message == NULL) return;
  size_t bytes = 0;
  for (size_t part = 0; part < message->msg_iovlen; part++) bytes += message->msg_iov[part].iov_len;
  flow_control_wait(message->msg_name, message->msg_namelen, bytes, by_the_clock);
}

void flow_control_in_child(void) {
  free_lock();
  if (diagnosis >= 0) close(diagnosis);
  diagnosis = -1;
}
