// SPDX-License-Identifier: Apache-2.0
#include "hw/can/socket_bus.h"

#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <sys/ioctl.h>
#include <sys/socket.h>

#include <array>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <optional>
#include <string_view>

#include "common/base/file_descriptor.h"
#include "hw/can/kernel_frame.h"
#include "hw/can/link_monitor.h"
#include "hw/can/stamp_clock.h"

namespace cairn {
namespace {

/// The facts that recvmsg() gave beside the bytes.
struct Reception {
  KernelFrame kernel;
  std::optional<int64_t> wall_stamp;  ///< [ns]
  std::optional<uint32_t> lost;       ///< so far
  int error = 0;                      ///< errno; EAGAIN: nothing there
};

template <typename T>
T content(const cmsghdr& header) {
  T value{};
  std::memcpy(&value, CMSG_DATA(&header), sizeof value);
  return value;
}

Reception receive_from(int descriptor) {
  Reception got;
  iovec place{&got.kernel.frame, sizeof got.kernel.frame};
  alignas(cmsghdr) std::array<char, CMSG_SPACE(sizeof(timespec)) + CMSG_SPACE(sizeof(uint32_t))> control{};
  msghdr message{};
  message.msg_iov = &place;
  message.msg_iovlen = 1;
  message.msg_control = control.data();
  message.msg_controllen = control.size();
  const ssize_t size = recvmsg(descriptor, &message, MSG_DONTWAIT);
  if (size < 0) got.error = errno;
  if (size == 0) got.error = ENXIO;  // the other end of a pair is closed
  if (size <= 0) return got;
  got.kernel.size = static_cast<size_t>(size);
  for (cmsghdr* header = CMSG_FIRSTHDR(&message); header != nullptr; header = CMSG_NXTHDR(&message, header)) {
    if (header->cmsg_level != SOL_SOCKET) continue;
    if (header->cmsg_type == SO_TIMESTAMPNS) {
      const auto stamp = content<timespec>(*header);
      got.wall_stamp = int64_t{stamp.tv_sec} * 1'000'000'000 + stamp.tv_nsec;
    } else if (header->cmsg_type == SO_RXQ_OVFL) {
      got.lost = content<uint32_t>(*header);
    }
  }
  return got;
}

/// Binds a socket to where its frames come from, again where that has gone; 0 when it is there and works,
/// else errno.
class Attachment {
 public:
  virtual ~Attachment() = default;
  [[nodiscard]] virtual int attach(int descriptor) = 0;
};

bool set_option(int descriptor, int level, int option, const void* value, size_t size) {
  return setsockopt(descriptor, level, option, value, static_cast<socklen_t>(size)) == 0;
}

class CanInterface final : public Attachment {
 public:
  CanInterface(std::string name, const std::vector<CanFilter>& filters) : name_(std::move(name)) {
    filters_.reserve(filters.size() + 1);
    for (const CanFilter& filter : filters) filters_.push_back(to_kernel(filter));
    if (filters.empty()) filters_.push_back({0, 0});  // passes all
  }

  int attach(int descriptor) override {
    const unsigned index = if_nametoindex(name_.c_str());
    if (index == 0) return ENXIO;
    if (static_cast<int>(index) != bound_index(descriptor)) {
      // With its interface a socket loses its filters.
      if (!set_option(descriptor, SOL_CAN_RAW, CAN_RAW_FILTER, filters_.data(),
                      filters_.size() * sizeof(can_filter))) {
        return errno;
      }
      sockaddr_can address{};
      address.can_family = AF_CAN;
      address.can_ifindex = static_cast<int>(index);
      if (bind(descriptor, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) return errno;
    }
    ifreq request{};
    name_.copy(request.ifr_name, IFNAMSIZ - 1);
    if (ioctl(descriptor, SIOCGIFFLAGS, &request) != 0) return errno;
    return (request.ifr_flags & IFF_UP) != 0 ? 0 : ENETDOWN;
  }

 private:
  /// 0: to none.
  static int bound_index(int descriptor) {
    sockaddr_can address{};
    socklen_t size = sizeof address;
    const bool known = getsockname(descriptor, reinterpret_cast<sockaddr*>(&address), &size) == 0;
    return known ? address.can_ifindex : 0;
  }

  std::string name_;
  std::vector<can_filter> filters_;
};

/// The other end of a pair never comes back.
class OtherEnd final : public Attachment {
 public:
  int attach(int) override { return ENXIO; }
};

/// CanBus on a socket that takes and gives the kernel's frames.
class SocketBus final : public CanBus {
 public:
  /// `filters`: those that the kernel does not apply.
  SocketBus(FileDescriptor socket, std::unique_ptr<Attachment> attachment, std::vector<CanFilter> filters)
      : socket_(std::move(socket)), attachment_(std::move(attachment)), filters_(std::move(filters)) {}

  SendOutcome send(const CanFrame& frame, Urgency urgency) override {
    if (!is_valid(frame)) return SendOutcome::kInvalid;
    const auto now = std::chrono::steady_clock::now();
    if (urgency == Urgency::kRoutine && !monitor_.may_send(now)) {
      monitor_.withheld();
      return SendOutcome::kWithheld;
    }
    const KernelFrame kernel = to_kernel(frame);
    if (::send(socket_.get(), &kernel.frame, kernel.size, MSG_DONTWAIT | MSG_NOSIGNAL) >= 0) {
      monitor_.sent();
      return SendOutcome::kQueued;
    }
    if (errno == EINVAL || errno == EMSGSIZE) return SendOutcome::kInvalid;
    monitor_.send_failed(errno == EPIPE || errno == ECONNRESET ? ENXIO : errno, now);
    return SendOutcome::kWithheld;
  }

  std::optional<ReceivedFrame> receive() override {
    while (true) {
      const auto now = std::chrono::steady_clock::now();
      if (const auto due = retry_at(); due && now >= *due) attach(now);
      const Reception got = receive_from(socket_.get());
      if (got.error == EAGAIN) return std::nullopt;
      if (got.error != 0) {
        monitor_.link_failed(got.error == ECONNRESET ? ENXIO : got.error, now);
        return std::nullopt;
      }
      if (got.lost) monitor_.lost_so_far(*got.lost);
      const auto content = from_kernel(got.kernel);
      if (const auto* errors = std::get_if<BusErrors>(&content)) monitor_.noticed(*errors, now);
      const auto* frame = std::get_if<CanFrame>(&content);
      if (frame == nullptr || !passes(filters_, *frame)) continue;
      monitor_.received(now);
      const auto clocks = StampClock::read();
      return ReceivedFrame{*frame, clock_.stamp(got.wall_stamp.value_or(clocks.wall), clocks)};
    }
  }

  int descriptor() const override {
    // A socket whose other end is gone would always be ready.
    return monitor_.health().condition == BusCondition::kInterfaceGone ? -1 : socket_.get();
  }
  std::optional<MonotonicTime> retry_at() const override { return monitor_.link_retry_at(); }
  const BusHealth& health() const override { return monitor_.health(); }

  void attach(MonotonicTime now) {
    if (const int error = attachment_->attach(socket_.get()); error != 0) {
      monitor_.link_failed(error, now);
    } else {
      monitor_.link_works();
    }
  }

 private:
  FileDescriptor socket_;
  std::unique_ptr<Attachment> attachment_;
  std::vector<CanFilter> filters_;
  LinkMonitor monitor_;
  StampClock clock_{StampClock::read()};
};

bool stamps_frames(int descriptor) {
  const int on = 1;
  return set_option(descriptor, SOL_SOCKET, SO_TIMESTAMPNS, &on, sizeof on);
}

bool set_can_options(int descriptor) {
  const int on = 1;
  const can_err_mask_t all_errors = CAN_ERR_MASK;
  return stamps_frames(descriptor) && set_option(descriptor, SOL_SOCKET, SO_RXQ_OVFL, &on, sizeof on) &&
         set_option(descriptor, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, &on, sizeof on) &&
         set_option(descriptor, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &all_errors, sizeof all_errors);
}

Error refusal(const std::string& interface_name, int error) {
  const auto with = [&](ErrorCode code, const std::string& why) {
    return Error{code, interface_name + ": " + why};
  };
  switch (error) {
    case ENXIO:
      return with(ErrorCode::kNotFound,
                  "no such interface; `ip -br link show type can` lists those of CAN, `sudo ip link add " +
                      interface_name + " type vcan` makes a virtual one");
    case ENODEV:
      return with(ErrorCode::kConfiguration,
                  "not a CAN interface; `ip -br link show type can` lists those that are");
    case EAFNOSUPPORT:
    case EPROTONOSUPPORT:
      return with(ErrorCode::kConfiguration,
                  "this kernel has no CAN; `sudo modprobe can-raw` loads it where there is a module");
    default:
      return with(ErrorCode::kIo, std::string("cannot be opened: ") + std::strerror(error));
  }
}

int option_of(int descriptor, int option) {
  int value = -1;
  socklen_t size = sizeof value;
  return getsockopt(descriptor, SOL_SOCKET, option, &value, &size) == 0 ? value : -1;
}

constexpr std::string_view kInherited = "fd:";

/// `name` with the number of a descriptor behind kInherited.
Result<std::unique_ptr<CanBus>> open_inherited(const std::string& name,
                                               const std::vector<CanFilter>& filters) {
  int descriptor = -1;
  const char* end = name.data() + name.size();
  const auto read = std::from_chars(name.data() + kInherited.size(), end, descriptor);
  const bool is_socket = read.ec == std::errc() && read.ptr == end && descriptor >= 0 &&
                         option_of(descriptor, SO_DOMAIN) == AF_UNIX &&
                         option_of(descriptor, SO_TYPE) == SOCK_SEQPACKET;
  if (!is_socket) {
    return fail(ErrorCode::kConfiguration,
                name +
                    ": no local socket of packets that this process was started with; whoever starts "
                    "both ends of a bus hands them out");
  }
  FileDescriptor socket(descriptor);
  if (!stamps_frames(socket.get())) return tl::unexpected(refusal(name, errno));
  while (receive_from(descriptor).error == 0) {
  }
  return std::make_unique<SocketBus>(std::move(socket), std::make_unique<OtherEnd>(), filters);
}

}  // namespace

Result<std::unique_ptr<CanBus>> open_can_bus(const std::string& interface_name,
                                             const std::vector<CanFilter>& filters) {
  if (interface_name.starts_with(kInherited)) return open_inherited(interface_name, filters);
  if (interface_name.empty() || interface_name.size() >= IFNAMSIZ) {
    return fail(ErrorCode::kUsage, "'" + interface_name + "': the name of an interface has 1 to " +
                                       std::to_string(IFNAMSIZ - 1) + " letters");
  }
  if (filters.size() > CAN_RAW_FILTER_MAX) {
    return fail(ErrorCode::kUsage, interface_name + ": " + std::to_string(filters.size()) +
                                       " filters; the kernel takes " + std::to_string(CAN_RAW_FILTER_MAX));
  }
  FileDescriptor socket(::socket(PF_CAN, SOCK_RAW | SOCK_CLOEXEC, CAN_RAW));
  if (socket.get() < 0 || !set_can_options(socket.get())) {
    return tl::unexpected(refusal(interface_name, errno));
  }
  auto interface = std::make_unique<CanInterface>(interface_name, filters);
  const int error = interface->attach(socket.get());
  if (error != 0 && error != ENETDOWN) return tl::unexpected(refusal(interface_name, error));
  auto bus = std::make_unique<SocketBus>(std::move(socket), std::move(interface), std::vector<CanFilter>());
  bus->attach(std::chrono::steady_clock::now());
  return bus;
}

Result<std::pair<std::unique_ptr<CanBus>, std::unique_ptr<CanBus>>> make_bus_pair(
    const std::vector<CanFilter>& first_filters, const std::vector<CanFilter>& second_filters) {
  std::array<int, 2> ends{-1, -1};
  const bool made = socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends.data()) == 0;
  FileDescriptor first(ends[0]);
  FileDescriptor second(ends[1]);
  if (!made || !stamps_frames(first.get()) || !stamps_frames(second.get())) {
    return fail(ErrorCode::kIo, std::string("no pair of sockets: ") + std::strerror(errno));
  }
  return std::pair<std::unique_ptr<CanBus>, std::unique_ptr<CanBus>>{
      std::make_unique<SocketBus>(std::move(first), std::make_unique<OtherEnd>(), first_filters),
      std::make_unique<SocketBus>(std::move(second), std::make_unique<OtherEnd>(), second_filters)};
}

}  // namespace cairn
