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
#include <sys/stat.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#define RECEIVERS 512u /* that are known at a time; a power of two */
#define PAUSE_NS 50000
#define TRIES 200 /* a pause each, for who has the lock */
#define CREDIT_PART 16 /* of the buffer: so much is sent before the kernel is asked again, as others send too */
/* So long nothing is taken by who has stopped; who gets no processor for a while, or reads slowly, has
 * not: what was read the kernel (udp_rmem_release) shows in quarters of the buffer. */
#define PATIENCE_NS 1000000000
/* By the clock what is due next waits as well: so long at most, and no more than a part of the time, and
 * for who has stopped not as long as others need it. */
#define LATE_NS 20000000
#define LATE_PART 4
#define LATE_PATIENCE_NS 200000000
/* Bytes that are sent to who is not found before it is looked for again. */
#define UNKNOWN 1000000
#define MOST_BYTES 65507 /* of a datagram */

struct receiver {
  struct sockaddr_in at; /* sin_port 0: a free place */
  int64_t room;          /* as the kernel counts it, before it is asked again */
  uint32_t waiting;      /* when it was asked last */
  int64_t full_since;    /* since when it was seen to read nothing; 0: it has room, or reads */
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
static ino_t diagnosis_inode;
static int64_t late_left = LATE_NS, late_at; /* how long may be waited by the clock, and since when */

static const struct timespec A_PAUSE = {0, PAUSE_NS};

/* Whoever has it for long may be what this signal has interrupted, or a thread that was cancelled: it is
 * taken from there. No address is out of bounds whoever else is inside. */
static void take_lock(void) {
  for (int tries = 0; tries < TRIES; tries++) {
    if (!atomic_flag_test_and_set_explicit(&lock, memory_order_acquire)) return;
    nanosleep(&A_PAUSE, NULL);
  }
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
  syscall(SYS_close, trial); /* none of the C library's, by which a thread may be cancelled */
  return own;
}

static struct receiver *find_in_table(const struct sockaddr_in *at) {
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

/* Receivers come and go: when the table is full all are forgotten. */
static struct receiver *find(const struct sockaddr_in *at) {
  struct receiver *found = find_in_table(at);
  if (found != NULL) return found;
  memset(receivers, 0, sizeof receivers);
  return find_in_table(at);
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
    ssize_t length =
        syscall(SYS_recvfrom, diagnosis, answer, sizeof answer, MSG_DONTWAIT, NULL, NULL);
    const struct nlmsghdr *header = (const struct nlmsghdr *)answer;
    if (length < 0 || !NLMSG_OK(header, (size_t)length)) return false;
    if (header->nlmsg_seq == number) return read_load(header, into);
  }
}

/* The program may have closed what it did not open, and have another file of that number by now: to
 * that nothing is written. Old C libraries have no fstat but by another name. */
static bool is_open(void) {
  struct stat is;
  return diagnosis >= 0 && syscall(SYS_fstat, diagnosis, &is) == 0 && is.st_ino == diagnosis_inode &&
         S_ISSOCK(is.st_mode);
}

static bool can_ask(void) {
  if (is_open()) return true;
  struct stat is;
  diagnosis = socket(AF_NETLINK, SOCK_RAW | SOCK_CLOEXEC, NETLINK_SOCK_DIAG);
  if (diagnosis < 0 || syscall(SYS_fstat, diagnosis, &is) != 0) return false;
  diagnosis_inode = is.st_ino;
  return true;
}

/* False where no such socket is found, or the kernel does not answer. */
static bool ask(const struct sockaddr_in *at, struct load *into) {
  static uint32_t number;
  if (!can_ask()) return false;
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
  struct sockaddr_nl kernel = {.nl_family = AF_NETLINK};
  ssize_t went = syscall(SYS_sendto, diagnosis, &question, sizeof question, MSG_DONTWAIT, &kernel,
                         sizeof kernel);
  return went == sizeof question && read_answer(number, into);
}

/* Whether so much may go out now; half of the room is left to what others send, who ask as well before
 * they send much. A quarter may wait where a datagram needs more: kernels of 2019 count that of a socket
 * that is empty. */
static bool has_room(struct receiver *receiver, int64_t needs) {
  if (receiver->room >= needs) return true;
  struct load load;
  if (!ask(&receiver->at, &load)) {
    receiver->room = UNKNOWN;
    return true;
  }
  int64_t free = (int64_t)load.most / 2 - load.waiting, credit = load.most / CREDIT_PART;
  if (credit < needs) credit = needs;
  receiver->room = free < credit ? free : credit;
  bool room = load.waiting <= load.most / 4 || free >= needs;
  if (room || load.waiting < receiver->waiting) {
    receiver->stopped = false;
    receiver->full_since = 0;
  }
  receiver->waiting = load.waiting;
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

static void await_room(const struct sockaddr_in *at, size_t bytes, bool by_the_clock) {
  int64_t needs = charge(bytes), patience = by_the_clock ? LATE_PATIENCE_NS : PATIENCE_NS;
  take_lock();
  struct receiver *receiver = find(at);
  if (receiver != NULL && receiver->foreign) receiver = NULL;
  while (receiver != NULL && !has_room(receiver, needs) && !receiver->stopped) {
    int64_t now = now_ns();
    if (receiver->full_since == 0) receiver->full_since = now;
    receiver->stopped = now - receiver->full_since >= patience;
    if (receiver->stopped || !may_wait(now, by_the_clock)) break;
    free_lock();
    nanosleep(&A_PAUSE, NULL);
    take_lock();
    if (by_the_clock) late_left -= now_ns() - now;
    receiver = find(at); /* the table may have been forgotten meanwhile */
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
  diagnosis = -1; /* its number may be another file's by now, and is not closed */
}
