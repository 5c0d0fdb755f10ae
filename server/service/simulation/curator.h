// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <fstream>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "server/service/simulation/operator.h"
#include "server/store/backup.h"

namespace cairn::simulation {

/// Tags maps, rolls them back, copies them, takes backups, and decides of proposals.
class Curator : public SimulatedOperator {
 public:
  /// How often he was told that it was done.
  struct Done {
    size_t tags = 0;
    size_t roll_backs = 0;
    size_t copies = 0;
    size_t accepted = 0;
    size_t dropped = 0;
    size_t restored = 0;  ///< backups
  };
  /// `folder`: for backups.
  Curator(World* world, std::string name, std::filesystem::path folder)
      : SimulatedOperator(world, std::move(name), std::chrono::milliseconds(400)),
        folder_(std::move(folder)) {}

  [[nodiscard]] const Done& done() const { return done_; }
  /// No server runs: restores the backups that were taken since, and looks at what is there then.
  void check_backups();

 private:
  /// One on its way, file by file.
  struct Taking {
    std::vector<std::string> parts;
    size_t next = 0;
    std::map<MapId, MadeMap> known;  ///< when its copy was asked for
    std::ofstream part;
    std::string token;
    uint64_t bytes = 0;
    uint64_t offset = 0;
    std::optional<BackupWriter> writer;
    std::filesystem::path file;
  };
  struct Taken {
    std::filesystem::path file;
    std::map<MapId, MadeMap> known;
  };

  [[nodiscard]] nlohmann::json some_verb(MapId map) override;
  void hear(const nlohmann::json& asked, const wire::AdminReply& reply) override;
  void hear_done(const std::string& verb, const nlohmann::json& asked, const nlohmann::json& told);
  void hear_proposals(const nlohmann::json& told);
  [[nodiscard]] nlohmann::json some_decision();
  [[nodiscard]] nlohmann::json some_tag_verb(const std::string& id);

  void go_on_with_backup(const std::string& verb, const nlohmann::json& told, const wire::AdminReply& reply);
  void ask_for_part();
  void ask_for_piece();
  [[nodiscard]] std::filesystem::path part_path() const { return folder_ / "part"; }

  const std::filesystem::path folder_;
  Done done_;
  MapId map_;  ///< that it is about
  int made_ = 0;
  bool is_welcome_ = false;
  std::vector<std::pair<MapId, std::string>> waiting_;  ///< proposals, as he was told last
  std::optional<Taking> taking_;
  std::vector<Taken> taken_;
};

}  // namespace cairn::simulation
