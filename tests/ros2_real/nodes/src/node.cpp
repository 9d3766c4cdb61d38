// A program with one of the nodes, or several: node EXECUTOR KIND... [--ros-args ...]
// Without a kind its exit status is 0 if this distribution has the executor.
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include <class_loader/class_loader.hpp>
#include <rclcpp/rclcpp.hpp>
#include <rclcpp_components/node_factory.hpp>
// Humble has none.
#if __has_include(<rclcpp/experimental/executors/events_executor/events_executor.hpp>)
#include <rclcpp/experimental/executors/events_executor/events_executor.hpp>
#define WITH_EVENTS
#endif

static std::shared_ptr<rclcpp::Executor> executor_named(const std::string &name) {
  if (name == "single") return std::make_shared<rclcpp::executors::SingleThreadedExecutor>();
  if (name == "multi")
    return std::make_shared<rclcpp::executors::MultiThreadedExecutor>(rclcpp::ExecutorOptions(), 4);
#ifdef WITH_EVENTS
  if (name == "events")
    return std::make_shared<rclcpp::experimental::executors::EventsExecutor>();
#endif
  return nullptr;
}

int main(int count, char **words) {
  const auto own = rclcpp::init_and_remove_ros_arguments(count, words);
  const auto executor = own.size() > 1 ? executor_named(own[1]) : nullptr;
  if (executor == nullptr) {
    std::fprintf(stderr, "usage: node single|multi|events Answering|Counting|Keeping|Passing|...\n");
    return 2;
  }
  if (own.size() == 2) return 0;
  class_loader::ClassLoader loader("libbagpipe_nodes.so");
  std::vector<rclcpp_components::NodeInstanceWrapper> nodes;
  for (size_t at = 2; at < own.size(); at++) {
    const auto name = "rclcpp_components::NodeFactoryTemplate<bagpipe_nodes::" + own[at] + ">";
    auto factory = loader.createInstance<rclcpp_components::NodeFactory>(name);
    nodes.push_back(factory->create_node_instance(rclcpp::NodeOptions()));
    executor->add_node(nodes.back().get_node_base_interface());
  }
  executor->spin();
  nodes.clear();
  rclcpp::shutdown();
  return 0;
}
