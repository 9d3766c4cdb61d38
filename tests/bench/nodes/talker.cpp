// Publishes std_msgs/String at a rate and stays until it is ended.
// talker <topic> <bytes> <messages> <per second, 0: no pause> [remappings]
// Begins a second after somebody has subscribed, so that no start counts as a loss; prints "done seconds S" after the last one.
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <thread>
#include <ros/ros.h>
#include <std_msgs/String.h>

int main(int argc, char** argv) {
  ros::init(argc, argv, "talker");
  if (argc < 5) return 2;
  const unsigned long messages = strtoul(argv[3], nullptr, 10);
  const double rate = atof(argv[4]);
  ros::NodeHandle node;
  // No limit: what is lost is lost by the recorder.
  ros::Publisher out = node.advertise<std_msgs::String>(argv[1], 0);
  std_msgs::String message;
  message.data = std::string(atoi(argv[2]), 'x');
  while (ros::ok() && out.getNumSubscribers() == 0) ros::WallDuration(0.01).sleep();
  ros::WallDuration(1.0).sleep();
  const auto begin = std::chrono::steady_clock::now();
  for (unsigned long n = 0; ros::ok() && n < messages; ++n) {
    if (rate > 0 && n % 16 == 0)
      std::this_thread::sleep_until(begin + std::chrono::duration<double>(n / rate));
    out.publish(message);
  }
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - begin;
  printf("done seconds %.9f\n", took.count());
  fflush(stdout);
  ros::spin();
}
