//! Foreign data sets turned into sessions.
