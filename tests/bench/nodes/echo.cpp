// Answers each std_msgs/String with itself and adds up the time that its callbacks take.
// echo <in> <out> [remappings]; prints "own N seconds S" every 500 messages.
#include <chrono>
#include <cstdio>
#include <ros/ros.h>
#include <std_msgs/String.h>

int main(int argc, char** argv) {
  ros::init(argc, argv, "echo");
  if (argc < 3) return 2;
  ros::NodeHandle node;
  ros::Publisher out = node.advertise<std_msgs::String>(argv[2], 0);
  unsigned long seen = 0;
  std::chrono::duration<double> own(0);
  boost::function<void(const std_msgs::StringConstPtr&)> answer =
      [&](const std_msgs::StringConstPtr& message) {
        const auto begin = std::chrono::steady_clock::now();
        out.publish(message);
        own += std::chrono::steady_clock::now() - begin;
        if (++seen % 500 == 0) {
          printf("own %lu seconds %.9f\n", seen, own.count());
          fflush(stdout);
        }
      };
  ros::TransportHints hints = ros::TransportHints().tcpNoDelay();
  ros::Subscriber in = node.subscribe<std_msgs::String>(argv[1], 0, answer, nullptr, hints);
  ros::spin();
}
