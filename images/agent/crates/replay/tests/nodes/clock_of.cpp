// Answers every std_msgs/String with the time that the callback sees.
// clock_of <in> <out> [remappings]
#include <string>
#include <ros/ros.h>
#include <std_msgs/String.h>

int main(int argc, char** argv) {
  ros::init(argc, argv, "clock_of");
  if (argc < 3) return 2;
  ros::NodeHandle node;
  ros::Publisher out = node.advertise<std_msgs::String>(argv[2], 0);
  boost::function<void(const std_msgs::StringConstPtr&)> answer =
      [&](const std_msgs::StringConstPtr&) {
        std_msgs::String now;
        now.data = std::to_string(ros::Time::now().toNSec());
        out.publish(now);
      };
  ros::Subscriber in = node.subscribe<std_msgs::String>(argv[1], 0, answer);
  ros::spin();
}
