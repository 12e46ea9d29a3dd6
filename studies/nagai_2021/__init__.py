"""What the published numbers of Nagai, Kurita, Shintake (2021) allow to conclude."""
