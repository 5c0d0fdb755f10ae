// SPDX-License-Identifier: Apache-2.0
#include "hw/app/interface_facts.h"

#include <linux/can/netlink.h>
#include <linux/if_link.h>
#include <linux/netlink.h>
#include <linux/rtnetlink.h>
#include <net/if.h>
#include <net/if_arp.h>
#include <sys/socket.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <functional>
#include <string_view>

#include "common/base/file_descriptor.h"

namespace cairn {
namespace {

using Attributes = std::string_view;  // bytes of attributes, one after another
using Visit = std::function<void(uint16_t type, Attributes content)>;

template <typename T>
std::optional<T> content_as(Attributes bytes) {
  if (bytes.size() < sizeof(T)) return std::nullopt;
  T value{};
  std::memcpy(&value, bytes.data(), sizeof(T));
  return value;
}

void for_each_attribute(Attributes bytes, const Visit& visit) {
  while (const auto header = content_as<rtattr>(bytes)) {
    if (header->rta_len < sizeof(rtattr) || header->rta_len > bytes.size()) return;
    visit(header->rta_type & NLA_TYPE_MASK, bytes.substr(sizeof(rtattr), header->rta_len - sizeof(rtattr)));
    const size_t aligned = RTA_ALIGN(header->rta_len);
    if (aligned >= bytes.size()) return;
    bytes.remove_prefix(aligned);
  }
}

void read_controller(Attributes bytes, InterfaceFacts* facts) {
  for_each_attribute(bytes, [facts](uint16_t type, Attributes content) {
    if (type == IFLA_CAN_BITTIMING) {
      if (const auto timing = content_as<can_bittiming>(content)) facts->bit_rate = timing->bitrate;
    } else if (type == IFLA_CAN_RESTART_MS) {
      facts->restart_ms = content_as<uint32_t>(content);
    } else if (type == IFLA_CAN_STATE) {
      facts->state = content_as<uint32_t>(content);
    } else if (type == IFLA_CAN_BERR_COUNTER) {
      if (const auto counters = content_as<can_berr_counter>(content)) {
        facts->transmit_errors = counters->txerr;
        facts->receive_errors = counters->rxerr;
      }
    }
  });
}

void read_link_info(Attributes bytes, InterfaceFacts* facts) {
  Attributes data;
  for_each_attribute(bytes, [&](uint16_t type, Attributes content) {
    if (type == IFLA_INFO_KIND)
      facts->kind = std::string(content.data(), strnlen(content.data(), content.size()));
    if (type == IFLA_INFO_DATA) data = content;
  });
  if (facts->kind == "can") read_controller(data, facts);
}

Error system_error(const std::string& name) {
  return {ErrorCode::kIo, name + ": the kernel does not tell of it: " + std::strerror(errno)};
}

}  // namespace

Result<InterfaceFacts> ask_interface(const std::string& name) {
  const unsigned index = if_nametoindex(name.c_str());
  if (index == 0)
    return fail(ErrorCode::kConfiguration,
                name +
                    ": there is no such interface; `ip -br link` lists those that are there. For an "
                    "adapter: is it plugged in? For a test: `sudo ip link add " +
                    name + " up type vcan`");
  const FileDescriptor socket_to_kernel(socket(AF_NETLINK, SOCK_RAW | SOCK_CLOEXEC, NETLINK_ROUTE));
  struct {
    nlmsghdr header;
    ifinfomsg info;
  } request{};
  request.header.nlmsg_len = sizeof request;
  request.header.nlmsg_type = RTM_GETLINK;
  request.header.nlmsg_flags = NLM_F_REQUEST;
  request.info.ifi_index = static_cast<int>(index);
  if (send(socket_to_kernel.get(), &request, sizeof request, 0) < 0)
    return tl::unexpected(system_error(name));
  std::array<char, 32768> answer{};
  const ssize_t size = recv(socket_to_kernel.get(), answer.data(), answer.size(), 0);
  if (size < 0) return tl::unexpected(system_error(name));
  const Attributes message(answer.data(), static_cast<size_t>(size));
  const auto header = content_as<nlmsghdr>(message);
  const auto info =
      message.size() < NLMSG_HDRLEN ? std::nullopt : content_as<ifinfomsg>(message.substr(NLMSG_HDRLEN));
  if (!header || header->nlmsg_type != RTM_NEWLINK || !info)
    return fail(ErrorCode::kIo, name + ": the kernel does not tell of it");
  InterfaceFacts facts;
  facts.is_can = info->ifi_type == ARPHRD_CAN;
  facts.is_up = (info->ifi_flags & IFF_UP) != 0;
  const size_t attributes = NLMSG_HDRLEN + NLMSG_ALIGN(sizeof(ifinfomsg));
  if (message.size() > attributes) {
    for_each_attribute(message.substr(attributes), [&facts](uint16_t type, Attributes content) {
      if (type == IFLA_LINKINFO) read_link_info(content, &facts);
    });
  }
  return facts;
}

}  // namespace cairn
