// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "common/base/result.h"
#include "common/wire/participant.h"
#include "common/wire/topic.h"
#include "common/wire/waiter.h"

namespace cairn {

struct AdminClientOptions {
  std::string server = "localhost";
  int domain = 0;
  std::string profile;        ///< empty: loopback for localhost, wifi otherwise
  std::string listen;         ///< interface or address of this machine; empty: that of the way to the server
  std::string security = {};  ///< folder of the operator's keys; empty: an open site
};

/// An operator's line to the server: one request at a time, sent again until it is answered. One thread.
class AdminClient {
 public:
  /// Waits for the server for a few seconds. Errors: kUsage (domain, host), kConfiguration (profile,
  /// interface), kNoServer.
  [[nodiscard]] static Result<AdminClient> connect(const AdminClientOptions& options);

  struct Answer {
    nlohmann::json content;
    std::vector<uint8_t> data;
  };
  /// Sets when to stop: from now on a request ends with an error (kIo) within a second after `requested`
  /// becomes true. It is called by the thread that waits.
  void stop_when(std::function<bool()> requested) { stop_requested_ = std::move(requested); }

  /// The server's answer. Errors: kNoServer (it went), or the server's refusal.
  [[nodiscard]] Result<Answer> ask(const nlohmann::json& request, std::vector<uint8_t> data = {});

  /// All maps: `maps` ascending by id, `deleted` the latest first; and `damaged` files that were set aside.
  [[nodiscard]] Result<nlohmann::json> maps();
  /// All labels of a map, ascending by id.
  [[nodiscard]] Result<nlohmann::json> labels(const std::string& map);

  using Progress = std::function<void(uint64_t bytes, uint64_t of)>;
  /// Downloads the archive of a map into `file`, of which an error may leave a part. Returns what the server
  /// says of the map.
  [[nodiscard]] Result<nlohmann::json> download(const std::string& map, const std::filesystem::path& file,
                                                const Progress& progress);
  /// Downloads what another request makes ready, which the server names by `token` and `bytes`.
  [[nodiscard]] Result<nlohmann::json> download(const nlohmann::json& request,
                                                const std::filesystem::path& file, const Progress& progress);
  /// Uploads an archive. Returns the map that the server has made of it. Errors do not name the file.
  [[nodiscard]] Result<nlohmann::json> upload(const std::filesystem::path& file, const Progress& progress);

 private:
  /// Downloads the pieces of a transfer, one after another, into a file.
  [[nodiscard]] Status fetch(const std::string& token, uint64_t size, const std::filesystem::path& file,
                             const Progress& progress);
  AdminClient(std::string name, wire::Participant participant, wire::Writer<wire::AdminRequest> requests,
              wire::Reader<wire::AdminReply> replies, wire::Waiter waiter);
  std::string name_;
  wire::Participant participant_;
  wire::Writer<wire::AdminRequest> requests_;
  wire::Reader<wire::AdminReply> replies_;
  wire::Waiter waiter_;
  std::function<bool()> stop_requested_ = [] { return false; };
  SessionId session_;
  uint64_t seq_ = 0;
};

}  // namespace cairn
