/* Sends datagrams through the flow control to sockets of this process, which are read while it
 * waits; its clock stands still otherwise. A line for each scene: what went out, what came, for how long
 * was waited, in µs, and how often the kernel was asked. */
#define _GNU_SOURCE
#include <arpa/inet.h>
#include <assert.h>
#include <errno.h>
#include <ifaddrs.h>
#include <stdio.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

static long waited_ns, asked;
static long crawl_ns; /* in which it reads once; 0: at each pause */
static int no_answers; /* whether the kernel has no sock_diag */
static void read_some(void);

static int stopped_clock(struct timespec *now) {
  *now = (struct timespec){1 + waited_ns / 1000000000, waited_ns % 1000000000};
  return 0;
}
static int passing(const struct timespec *pause) {
  waited_ns += pause->tv_nsec;
  if (crawl_ns == 0 || waited_ns % crawl_ns == 0) read_some();
  return 0;
}
static int opened(int family, int kind, int protocol) {
  if (no_answers) return errno = EPROTONOSUPPORT, -1;
  return socket(family, kind, protocol);
}

#define clock_gettime(clock, now) stopped_clock(now)
#define nanosleep(pause, rest) passing(pause)
#define socket(family, kind, protocol) opened(family, kind, protocol)
#define syscall(number, ...) (asked += (number) == SYS_recvfrom, syscall(number, __VA_ARGS__))
#include "flow_control.c"
#undef socket
#undef syscall

static bool by_the_clock;

#define ROOM 100000 /* the kernel doubles it */
#define LARGE_ROOM 1000000

static struct sockaddr_in at;
static int from, to, reads;
static long came, later; /* `later`: of those that went out from number `from_number` on */
static uint32_t number, from_number = UINT32_MAX;
static char data[65507], taken_data[65507];

static long take(long most) {
  long taken = 0;
  while (taken < most && recv(to, taken_data, sizeof taken_data, MSG_DONTWAIT) >= 0) {
    uint32_t one;
    memcpy(&one, taken_data, sizeof one);
    if (one >= from_number) later++;
    taken++;
  }
  came += taken;
  return taken;
}
static void read_some(void) { take(reads); }

static void open_both(const char *address, int room) {
  from = socket(AF_INET, SOCK_DGRAM, 0);
  to = socket(AF_INET, SOCK_DGRAM, 0);
  assert(setsockopt(to, SOL_SOCKET, SO_RCVBUF, &room, sizeof room) == 0);
  at = (struct sockaddr_in){.sin_family = AF_INET};
  assert(inet_pton(AF_INET, address, &at.sin_addr) == 1);
  assert(bind(to, (struct sockaddr *)&at, sizeof at) == 0);
  socklen_t length = sizeof at;
  assert(getsockname(to, (struct sockaddr *)&at, &length) == 0);
  came = waited_ns = asked = 0;
}
static void put(size_t bytes) {
  memcpy(data, &number, sizeof number), number++;
  flow_control_wait((struct sockaddr *)&at, sizeof at, bytes, by_the_clock);
  assert(sendto(from, data, bytes, 0, (struct sockaddr *)&at, sizeof at) == (ssize_t)bytes);
}
static void put_in_parts(size_t bytes) {
  struct iovec parts[2] = {{data, bytes / 2}, {data, bytes - bytes / 2}};
  struct msghdr whole = {.msg_name = &at, .msg_namelen = sizeof at, .msg_iov = parts, .msg_iovlen = 2};
  flow_control_wait_message(&whole, by_the_clock);
  assert(sendmsg(from, &whole, 0) == (ssize_t)bytes);
}
static void end(const char *scene, long sent) {
  take(sent);
  printf("%s %ld %ld %ld %ld\n", scene, sent, came, waited_ns / 1000, asked);
  close(from), close(to);
}

static void stream(const char *scene, long sent, size_t bytes, int each_pause, int each_send,
                   const char *address) {
  open_both(address, ROOM);
  reads = each_pause;
  for (long one = 0; one < sent; one++) {
    if (one % 2) put(bytes); else put_in_parts(bytes);
    take(each_send);
  }
  end(scene, sent);
}

/* It reads nothing, then everything, then nothing again. */
static void stops(void) {
  open_both("127.0.0.1", ROOM);
  reads = 0;
  for (int one = 0; one < 40; one++) put(60000);
  printf("stopped 40 0 %ld %ld\n", waited_ns / 1000, asked);
  take(40);
  came = waited_ns = asked = 0;
  for (int one = 0; one < 40; one++) put(60000);
  end("stopped-again", 40);
}

/* It stops, and then reads slower than is sent: of the last 400 datagrams so many come. What it reads the
 * kernel shows in quarters of its room. */
static void goes_on(void) {
  open_both("127.0.0.1", LARGE_ROOM);
  reads = 0;
  for (int one = 0; one < 80; one++) put(14720);
  reads = 1;
  for (int one = 0; one < 550; one++) {
    if (one == 150) from_number = number;
    put(14720);
    if (one % 2) take(1);
  }
  take(80);
  printf("goes-on 400 %ld %ld %ld\n", later, waited_ns / 1000, asked);
  from_number = UINT32_MAX;
  close(from), close(to);
}

/* It reads a datagram in 10 ms. */
static void crawls(void) {
  open_both("127.0.0.1", LARGE_ROOM);
  crawl_ns = 10000000;
  reads = 1;
  for (int one = 0; one < 200; one++) put(14720);
  crawl_ns = 0;
  end("crawls", 200);
}

/* A reader of one datagram in 50 ms, beside which others are to be in time. */
static void keeps_to_the_clock(void) {
  by_the_clock = true;
  open_both("127.0.0.1", ROOM);
  late_left = LATE_NS, late_at = now_ns();
  reads = 0;
  for (int one = 0; one < 300; one++) {
    put(60000);
    if (one % 100 == 99) take(1);
  }
  end("by-the-clock", 300);
  by_the_clock = false;
}

/* The most that the kernel counts for one datagram beyond what is taken for it, of each size. */
static void charges(void) {
  long beyond = -1;
  open_both("127.0.0.1", ROOM);
  for (size_t bytes = 1; bytes <= 65507; bytes += bytes < 3000 ? 1 : 211) {
    struct load load;
    put(bytes);
    assert(ask(&at, &load));
    long more = (long)load.waiting - charge(bytes);
    if (more > beyond) beyond = more;
    take(1);
  }
  printf("charges %ld\n", beyond);
}

/* A little waits all the time, before datagrams that need more than half of the room. */
static void alternates(void) {
  open_both("127.0.0.1", ROOM);
  reads = 0;
  for (int one = 0; one < 100; one++) {
    put(1000), put(65507);
    take(2);
  }
  end("alternates", 200);
}

/* Who was interrupted never goes on; and a child of a fork begins in the midst of it. */
static void interrupted(void) {
  open_both("127.0.0.1", ROOM);
  reads = 0;
  take_lock();
  put(60000);
  end("interrupted", 1);
  open_both("127.0.0.1", ROOM);
  take_lock();
  flow_control_in_child();
  put(60000);
  end("child", 1);
}

/* The program has closed what it did not open, and has a connection of its own of that number. */
static void replaced(void) {
  int pair[2];
  open_both("127.0.0.1", ROOM);
  reads = 1;
  put(60000);
  assert(socketpair(AF_UNIX, SOCK_STREAM, 0, pair) == 0);
  assert(write(pair[1], "theirs", 6) == 6);
  int theirs = diagnosis;
  assert(dup2(pair[0], theirs) == theirs);
  for (int one = 0; one < 39; one++) put(60000);
  char text[8];
  long written = recv(pair[1], text, sizeof text, MSG_DONTWAIT);
  long left = recv(theirs, text, sizeof text, MSG_DONTWAIT);
  take(40);
  printf("replaced 40 %ld %ld %ld\n", came, written, left);
  close(pair[0]), close(pair[1]), close(theirs), close(from), close(to);
}

/* More receivers than are known at a time, and then one that reads. */
static void many(void) {
  open_both("127.0.0.1", ROOM);
  struct sockaddr_in gone = at;
  for (uint32_t one = 0; one < 2 * RECEIVERS; one++) {
    gone.sin_port = htons((uint16_t)(10000 + one));
    flow_control_wait((struct sockaddr *)&gone, sizeof gone, 1000, false);
  }
  reads = 1;
  for (int one = 0; one < 200; one++) put(65000);
  end("many", 200);
}

/* By the clock, a message of ten datagrams each 0.1 s to one that has stopped and to one that reads: of the
 * latter so many come of the last ten messages. */
static void neighbour(void) {
  by_the_clock = true;
  open_both("127.0.0.1", ROOM);
  struct sockaddr_in stopped_at = at;
  int stopped = to, other = from;
  open_both("127.0.0.1", ROOM);
  late_left = LATE_NS, late_at = now_ns();
  reads = 1;
  for (int message = 0; message < 40; message++) {
    if (message == 30) came = 0;
    struct sockaddr_in reads_at = at;
    at = stopped_at;
    for (int one = 0; one < 10; one++) put(60000);
    at = reads_at;
    for (int one = 0; one < 10; one++) put(60000);
    take(10);
    waited_ns += 100000000;
  }
  end("neighbour", 100);
  close(stopped), close(other);
  by_the_clock = false;
}

/* An address of this machine that is none of 127.0.0.0/8, if it has one. */
static const char *own_address(void) {
  static char text[INET_ADDRSTRLEN] = "127.0.0.1";
  struct ifaddrs *all;
  assert(getifaddrs(&all) == 0);
  for (struct ifaddrs *one = all; one != NULL; one = one->ifa_next) {
    if (one->ifa_addr == NULL || one->ifa_addr->sa_family != AF_INET) continue;
    struct in_addr found = ((struct sockaddr_in *)one->ifa_addr)->sin_addr;
    if (ntohl(found.s_addr) >> 24 != IN_LOOPBACKNET) inet_ntop(AF_INET, &found, text, sizeof text);
  }
  freeifaddrs(all);
  return text;
}

/* To addresses that this machine has not, of which nothing is sent. */
static void elsewhere(void) {
  waited_ns = asked = 0;
  const char *all[] = {"198.51.100.1", "239.255.0.1", "255.255.255.255", "0.0.0.0"};
  for (int one = 0; one < 400; one++) {
    struct sockaddr_in there = {.sin_family = AF_INET, .sin_port = at.sin_port};
    assert(inet_pton(AF_INET, all[one % 4], &there.sin_addr) == 1);
    flow_control_wait((struct sockaddr *)&there, sizeof there, 60000, false);
  }
  printf("elsewhere 400 0 %ld %ld\n", waited_ns / 1000, asked);
}

int main(void) {
  stream("slow", 200, 65000, 1, 0, "127.0.0.1");
  stream("interface", 200, 65000, 1, 0, own_address());
  elsewhere();
  stream("quick", 20000, 1000, 1, 1, "127.0.0.1");
  stops();
  goes_on();
  crawls();
  alternates();
  keeps_to_the_clock();
  charges();
  interrupted();
  replaced();
  many();
  neighbour();
  open_both("127.0.0.1", ROOM);
  close(to);
  for (int one = 0; one < 100; one++) put(60000);
  printf("nobody 100 0 %ld %ld\n", waited_ns / 1000, asked);
  close(from);
  diagnosis = -1, no_answers = 1;
  stream("unanswered", 40, 60000, 1, 0, "127.0.0.1");
  return 0;
}
