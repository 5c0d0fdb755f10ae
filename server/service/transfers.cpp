// SPDX-License-Identifier: Apache-2.0
#include "server/service/transfers.h"

#include <cerrno>
#include <cstring>
#include <fstream>
#include <utility>

#include "common/map/ids.h"

namespace cairn {

Transfers::~Transfers() {
  while (!touched_.empty()) end(std::string(touched_.begin()->first));
}

Status Transfers::make_room(MonotonicTime now) {
  expire(now);
  if (touched_.size() < kMost) return {};
  return fail(ErrorCode::kRefused, std::to_string(touched_.size()) +
                                       " archives are on their way already; wait for one to end, or " +
                                       std::to_string(kPatience.count()) + " minutes for those left behind");
}

Result<std::string> Transfers::begin_export(MonotonicTime now) {
  if (Status room = make_room(now); !room) return tl::unexpected(room.error());
  std::string token = "export-" + std::to_string(++exports_);
  end(token);  // an operator's own import may be called so
  touched_[token] = now;
  return token;
}

Status Transfers::begin_import(const std::string& token, MonotonicTime now) {
  if (!is_valid_name(token)) return fail(ErrorCode::kUsage, "'" + token + "' is not a transfer");
  end(token);
  if (Status room = make_room(now); !room) return room;
  errno = 0;  // a stream keeps it, and says nothing else
  const std::ofstream out(path_of(token), std::ios::binary | std::ios::trunc);
  if (!out) {
    return fail(ErrorCode::kIo, path_of(token).string() + ": cannot be made: " + std::strerror(errno) +
                                    "; see to space, owner and mount of the server's store");
  }
  touched_[token] = now;
  return {};
}

Result<std::filesystem::path> Transfers::find(const std::string& token, MonotonicTime now) {
  const auto known = touched_.find(token);
  if (known == touched_.end()) return fail(ErrorCode::kNotFound, "no such transfer; begin it anew");
  known->second = now;
  return path_of(token);
}

Result<std::vector<uint8_t>> Transfers::read(const std::string& token, uint64_t offset, size_t most,
                                             MonotonicTime now) {
  const auto path = find(token, now);
  if (!path) return tl::unexpected(path.error());
  std::ifstream in(*path, std::ios::binary);
  if (!in) return fail(ErrorCode::kIo, path->string() + ": cannot be read");
  in.seekg(static_cast<std::streamoff>(offset));
  std::vector<uint8_t> data(most);
  in.read(reinterpret_cast<char*>(data.data()), static_cast<std::streamsize>(most));
  data.resize(static_cast<size_t>(in.gcount()));
  if (in.eof() || in.peek() == std::ifstream::traits_type::eof()) end(token);
  return data;
}

Status Transfers::write(const std::string& token, uint64_t offset, std::span<const uint8_t> data,
                        MonotonicTime now) {
  const auto path = find(token, now);
  if (!path) return tl::unexpected(path.error());
  if (offset > kMostBytes || data.size() > kMostBytes - offset)
    return fail(ErrorCode::kRefused, "too large for an archive");
  errno = 0;
  std::fstream out(*path, std::ios::binary | std::ios::in | std::ios::out);
  out.seekp(static_cast<std::streamoff>(offset));
  out.write(reinterpret_cast<const char*>(data.data()), static_cast<std::streamsize>(data.size()));
  out.close();
  if (out) return {};
  const std::string why = std::strerror(errno);
  end(token);  // on a full disk what has come of it is in the way of all else
  return fail(ErrorCode::kIo, path->string() + ": cannot be written: " + why +
                                  "; see to space, owner and mount of the server's store");
}

void Transfers::end(const std::string& token) {
  if (touched_.erase(token) == 0) return;
  std::error_code ignored;
  std::filesystem::remove(path_of(token), ignored);
}

void Transfers::expire(MonotonicTime now) {
  std::vector<std::string> idle;
  for (const auto& [token, touched] : touched_) {
    if (now - touched > kPatience) idle.push_back(token);
  }
  for (const std::string& token : idle) end(token);
}

}  // namespace cairn
