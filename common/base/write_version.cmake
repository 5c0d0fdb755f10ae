# cmake -D SOURCE=DIR -D VERSION=X.Y.Z -D OUT=FILE -P write_version.cmake: runs at each build, as a commit does not configure
# anew; the file is written only when its text changes.
set(CAIRN_FULL_VERSION ${VERSION})
if(EXISTS ${SOURCE}/.git)  # not the repository of someone who unpacked our sources in it
  # safe.directory: root builds what another owns. No optional locks: a build must not disturb a commit being made.
  execute_process(
    COMMAND ${CMAKE_COMMAND} -E env GIT_OPTIONAL_LOCKS=0
            git -c safe.directory=${SOURCE} -C ${SOURCE} describe --always --exclude=* --abbrev=8 --dirty=.dirty
    OUTPUT_VARIABLE commit OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET RESULT_VARIABLE failed)
  if(NOT failed)
    string(APPEND CAIRN_FULL_VERSION "+g${commit}")
  endif()
endif()
configure_file(${CMAKE_CURRENT_LIST_DIR}/version.cpp.in ${OUT} @ONLY)
