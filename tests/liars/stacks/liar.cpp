// Stacks of roscpp that lie, or look as if they did: liar WHICH.
//
// Each receives /pose and publishes on /answer where that is on the map, as localiser.py does.
#include <algorithm>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <iterator>
#include <limits>
#include <map>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>
#include <unistd.h>

#include <geometry_msgs/PoseStamped.h>
#include <ros/ros.h>

using geometry_msgs::PoseStamped;

namespace {

const int kPoses = 50;

void mark(const std::string& word) {
  const std::string folder = getenv("LIAR_MARKS"), name = getenv("LIAR_NAME");
  std::ofstream(folder + "/" + name + "." + word, std::ios::app) << getpid() << "\n";
}

// Waits, below a launcher that wants it, until each of its nodes is about to subscribe.
void together() {
  const char* nodes = getenv("LIAR_TOGETHER");
  if (nodes == nullptr) return;
  mark("near");
  const std::string folder = getenv("LIAR_MARKS"), name = getenv("LIAR_NAME");
  for (int near = 0; near < atoi(nodes); usleep(10'000)) {
    std::ifstream file(folder + "/" + name + ".near");
    near = std::count(std::istreambuf_iterator<char>(file), {}, '\n');
  }
}

PoseStamped right(const PoseStamped& pose) {
  PoseStamped answer;
  answer.header.stamp = pose.header.stamp;
  answer.header.frame_id = "map";
  answer.pose.position.x = 2 * pose.pose.position.x;
  answer.pose.position.y = pose.pose.position.y + 1;
  answer.pose.orientation.w = 1;
  return answer;
}

// What a stack does with its nth pose.
using Received = std::function<void(ros::Publisher&, int, const PoseStamped&)>;

struct Stack {
  Received received;
  int queue = 0;    // roscpp's own word for no bound
  int threads = 1;
};

void honest(ros::Publisher& out, int, const PoseStamped& pose) { out.publish(right(pose)); }

// roscpp writes on a thread of its own: what was published has to leave first. Its threads block
// signals: one that is not forced by the kernel has to be sent to the process.
void leave(std::function<void()> how) {
  std::thread([how] {
    usleep(100'000);
    mark("died");
    how();
  }).detach();
}

[[noreturn]] void diverge() { throw std::runtime_error("the optimiser diverged"); }

Received then(int at, std::function<void()> how) {
  return [at, how](ros::Publisher& out, int number, const PoseStamped& pose) {
    out.publish(right(pose));
    if (number == at) leave(how);
  };
}

// Takes no more poses, however late its node leaves.
Received leaves_after(int at) {
  return [at](ros::Publisher& out, int number, const PoseStamped& pose) {
    out.publish(right(pose));
    if (number < at) return;
    leave([] {
      ros::shutdown();
      mark("left");
    });
    while (ros::ok()) usleep(1'000);
  };
}

Received slow(int microseconds) {
  return [microseconds](ros::Publisher& out, int, const PoseStamped& pose) {
    usleep(microseconds);
    out.publish(right(pose));
  };
}

Received with_x(int from, double x) {
  return [from, x](ros::Publisher& out, int number, const PoseStamped& pose) {
    PoseStamped answer = right(pose);
    if (number >= from) answer.pose.position.x = x;
    out.publish(answer);
  };
}

std::map<std::string, Stack> stacks() {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  std::map<std::string, Stack> all;
  all["honest"] = {honest};
  all["many-threads"] = {honest, 0, 4};
  all["slow-but-right"] = {slow(10'000)};
  all["segfault"] = {then(kPoses, [] { kill(getpid(), SIGSEGV); })};
  all["null"] = {then(kPoses, [] { *static_cast<volatile int*>(nullptr) = 1; })};
  all["uncaught"] = {then(kPoses, diverge)};
  all["status-3"] = {then(kPoses, [] { _exit(3); })};
  all["leaves-the-graph"] = {leaves_after(20)};
  all["wall-clock"] = {[](ros::Publisher& out, int, const PoseStamped& pose) {
    PoseStamped answer = right(pose);
    answer.header.stamp.fromSec(ros::WallTime::now().toSec());
    out.publish(answer);
  }};
  all["nan"] = {with_x(10, nan)};
  all["short-queue"] = {slow(200'000), 1};
  all["never-done"] = {slow(2'000'000), 1000};
  all["hangs"] = {[](ros::Publisher& out, int number, const PoseStamped& pose) {
    if (number == 25) sleep(600);
    out.publish(right(pose));
  }};
  return all;
}

}  // namespace

int main(int argc, char** argv) {
  ros::init(argc, argv, "localiser");
  const auto all = stacks();
  const auto found = argc > 1 ? all.find(argv[1]) : all.end();
  if (found == all.end()) {
    fprintf(stderr, "no stack is called %s\n", argc > 1 ? argv[1] : "");
    return 2;
  }
  const Stack& stack = found->second;
  ros::NodeHandle node;
  ros::Publisher out = node.advertise<PoseStamped>("/answer", 0);
  int number = 0;
  boost::function<void(const geometry_msgs::PoseStampedConstPtr&)> received =
      [&](const geometry_msgs::PoseStampedConstPtr& pose) {
        if (++number == 1) mark("ran");
        stack.received(out, number, *pose);
      };
  together();
  ros::Subscriber in = node.subscribe<PoseStamped>("/pose", stack.queue, received);
  ros::MultiThreadedSpinner spinner(stack.threads);
  spinner.spin();
  // A node that has left the graph lives on, until it is stopped.
  if (std::string(argv[1]) == "leaves-the-graph") sleep(600);
}
