// Counts std_msgs/String messages until none has come for a while.
// counter <topic> <expected> [remappings]; prints "ready", then "received N seconds S".
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <ros/callback_queue.h>
#include <ros/ros.h>
#include <std_msgs/String.h>

using Clock = std::chrono::steady_clock;

int main(int argc, char** argv) {
  ros::init(argc, argv, "counter");
  if (argc < 3) return 2;
  const unsigned long expected = strtoul(argv[2], nullptr, 10);
  unsigned long seen = 0;
  Clock::time_point first, last = Clock::now();
  ros::NodeHandle node;
  boost::function<void(const std_msgs::StringConstPtr&)> count =
      [&](const std_msgs::StringConstPtr&) {
        last = Clock::now();
        if (seen++ == 0) first = last;
      };
  ros::Subscriber in = node.subscribe<std_msgs::String>(argv[1], 0, count);
  printf("ready\n");
  fflush(stdout);
  while (ros::ok() && seen < expected) {
    ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(0.1));
    // Whoever loses messages never reaches the expected number.
    if (seen > 0 && Clock::now() - last > std::chrono::seconds(2)) break;
  }
  const double seconds = std::chrono::duration<double>(last - first).count();
  printf("received %lu seconds %.9f\n", seen, seconds);
  fflush(stdout);
  // The publisher asks for our statistics while we stand.
  while (ros::ok()) ros::getGlobalCallbackQueue()->callAvailable(ros::WallDuration(0.1));
}
