"""What every part may use: tables, files, downloads, messages, and MuJoCo set up quietly."""
