// Relays JointStates and says how many callbacks have run.
// relay <in> <out> <queue> <microseconds in the callback> [remappings]
// Negative microseconds are computed, the others slept.
#include <cstdio>
#include <cstdlib>
#include <unistd.h>
#include <ros/ros.h>
#include <sensor_msgs/JointState.h>

int main(int argc, char** argv) {
  ros::init(argc, argv, "relay");
  if (argc < 5) return 2;
  const int busy = atoi(argv[4]);
  ros::NodeHandle node;
  ros::Publisher out = node.advertise<sensor_msgs::JointState>(argv[2], 0);
  unsigned long seen = 0;
  boost::function<void(const sensor_msgs::JointStateConstPtr&)> relay =
      [&](const sensor_msgs::JointStateConstPtr& message) {
        if (busy > 0) usleep(busy);
        const auto until = ros::WallTime::now() + ros::WallDuration(-busy / 1e6);
        while (ros::WallTime::now() < until) {
        }
        out.publish(message);
        printf("seen %lu\n", ++seen);
        fflush(stdout);
      };
  ros::Subscriber in = node.subscribe<sensor_msgs::JointState>(argv[1], atoi(argv[3]), relay);
  ros::spin();
}
