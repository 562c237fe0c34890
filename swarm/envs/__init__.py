"""Other libraries' doors to the world."""
