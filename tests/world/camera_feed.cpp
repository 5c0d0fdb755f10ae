// SPDX-License-Identifier: Apache-2.0
#include "tests/world/camera_feed.h"

#include <poll.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>

namespace cairn {
namespace {

constexpr int kBacklog = 8;
constexpr std::chrono::seconds kKept{1};

/// A moment as it lies in a packet, in the byte order of the machine, which both ends share.
struct Packet {
  int64_t time;                  ///< [ns]
  std::array<double, 3> center;  ///< [m]
  std::array<double, 4> turn;    ///< x y z w
};

std::string reason() {
  return std::strerror(errno);
}

Result<sockaddr_un> address_of(const std::string& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path.empty() || path.size() >= sizeof(address.sun_path)) {
    return fail(ErrorCode::kUsage, "'" + path + "': no path for a socket; it has 1 to " +
                                       std::to_string(sizeof(address.sun_path) - 1) + " bytes");
  }
  std::copy(path.begin(), path.end(), static_cast<char*>(address.sun_path));
  return address;
}

FileDescriptor make_socket(int flags) {
  return FileDescriptor(socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | flags, 0));
}

bool connects(const FileDescriptor& to, const sockaddr_un& address) {
  return connect(to.get(), reinterpret_cast<const sockaddr*>(&address), sizeof(address)) == 0;
}

}  // namespace

Result<CameraFeed> CameraFeed::open(const std::string& path) {
  const auto address = address_of(path);
  if (!address) return tl::unexpected(address.error());
  if (connects(make_socket(0), *address))
    return fail(ErrorCode::kRefused, path + ": another process feeds a camera there; name another path");
  struct stat found {};
  const bool is_left = errno == ECONNREFUSED && stat(path.c_str(), &found) == 0 && S_ISSOCK(found.st_mode);
  if (is_left) unlink(path.c_str());
  FileDescriptor listener = make_socket(SOCK_NONBLOCK);
  if (listener.get() < 0 ||
      bind(listener.get(), reinterpret_cast<const sockaddr*>(&*address), sizeof(*address)) != 0 ||
      listen(listener.get(), kBacklog) != 0)
    return fail(ErrorCode::kIo, path + ": " + reason());
  return CameraFeed(std::move(listener), path);
}

CameraFeed::~CameraFeed() {
  if (listener_.get() >= 0) unlink(path_.c_str());
}

void CameraFeed::tell(const CameraMoment& moment) {
  for (;;) {
    FileDescriptor reader(accept4(listener_.get(), nullptr, nullptr, SOCK_CLOEXEC | SOCK_NONBLOCK));
    if (reader.get() < 0) break;
    readers_.push_back(std::move(reader));
  }
  const Eigen::Vector3d& center = moment.map_from_camera.translation();
  const Eigen::Quaterniond& turn = moment.map_from_camera.rotation();
  const Packet packet{moment.time.nanoseconds,
                      {center.x(), center.y(), center.z()},
                      {turn.x(), turn.y(), turn.z(), turn.w()}};
  std::erase_if(readers_, [&packet](const FileDescriptor& reader) {
    const ssize_t sent = send(reader.get(), &packet, sizeof(packet), MSG_NOSIGNAL);
    return sent < 0 && errno != EAGAIN;
  });
}

Result<CameraTruth> CameraTruth::join(const std::string& path) {
  const auto address = address_of(path);
  if (!address) return tl::unexpected(address.error());
  FileDescriptor made = make_socket(SOCK_NONBLOCK);
  if (!connects(made, *address)) {
    return fail(ErrorCode::kNotFound, path + ": no simulated camera is told of there (" + reason() +
                                          "); start `cairn-rig simulate --camera " + path + "`");
  }
  return CameraTruth(std::move(made));
}

CameraTruth::News CameraTruth::wait(std::chrono::milliseconds most) {
  pollfd ready{socket_.get(), POLLIN, 0};
  if (poll(&ready, 1, static_cast<int>(most.count())) <= 0) return News::kNone;
  News news = News::kNone;
  for (;;) {
    Packet packet{};
    const ssize_t size = recv(socket_.get(), &packet, sizeof(packet), 0);
    if (size < 0 && (errno == EAGAIN || errno == EINTR)) return news;
    if (size != sizeof(packet)) return News::kEnd;
    const auto& [time, at, turn] = packet;
    moments_.push_back(
        {{time},
         SE3(Eigen::Quaterniond(turn[3], turn[0], turn[1], turn[2]), Eigen::Vector3d(at[0], at[1], at[2]))});
    while (moments_.back().time - moments_.front().time > kKept) moments_.pop_front();
    news = News::kSome;
  }
}

std::optional<Timestamp> CameraTruth::newest() const {
  return moments_.empty() ? std::nullopt : std::optional(moments_.back().time);
}

std::optional<Timestamp> CameraTruth::oldest() const {
  return moments_.empty() ? std::nullopt : std::optional(moments_.front().time);
}

SE3 CameraTruth::map_from_camera(Timestamp time) const {
  const auto after =
      std::lower_bound(moments_.begin(), moments_.end(), time,
                       [](const CameraMoment& moment, Timestamp t) { return moment.time < t; });
  if (after == moments_.end()) return moments_.back().map_from_camera;
  if (after == moments_.begin()) return after->map_from_camera;
  const CameraMoment& before = *(after - 1);
  const double part = seconds_between(time, before.time) / seconds_between(after->time, before.time);
  const SE3& from = before.map_from_camera;
  const SE3& to = after->map_from_camera;
  return {from.rotation().slerp(part, to.rotation()),
          from.translation() + part * (to.translation() - from.translation())};
}

}  // namespace cairn
